"""What is left after naming: can it be predicted from logged signals, is it somewhere in time, or is it just there?

Predictable: a ridge regression on signals, their squares and lags is fitted to the residual on some logs (or parts) and
asked about the others. Chance is measured by the same regression on the residual shifted in time, in a circle.
Localised: how few seconds hold half of the energy above the noise.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tselab.gap.data import CHANNELS
from tselab.gap.problem import Problem

LAGS = (0, 2, 5, 10)  # blocks of 0.04 s
FOLDS = 5
SHIFTS = 39  # 1 in 40: a p value of 0.025
RIDGE = 30.0
PREDICTABLE = 0.15  # of the energy above the noise that must be predicted to be worth words
LOCAL = 0.15  # of the time: half of the energy in less is localised


@dataclass(frozen=True)
class Remainder:
    """What the residual of one channel looks like."""

    channel: str
    gap: float  # rms over noise
    kind: str  # noise, predictable, localised, disturbance
    share: float  # of the energy above the noise that signals predict, out of sample
    signals: tuple[str, ...]  # the best of them
    time: tuple[float, float, str] | None  # s, s, log: where half of it is
    words: str


def remainder(problem: Problem, residuals: np.ndarray, features: dict[str, np.ndarray], limit: float) -> list[Remainder]:
    """Every channel; `limit`: rms over noise up to which nothing is left."""
    found = []
    rng = np.random.default_rng(1)
    for c in np.unique(problem.rows.channel):
        mine = (problem.rows.channel == c) & (problem.weight > 0)
        e, log, time = residuals[mine], problem.rows.log[mine], problem.rows.time[mine]
        size = float(np.sqrt(np.mean(e**2)))
        channel = CHANNELS[c]
        if size <= limit:
            found.append(Remainder(channel, size, "noise", 0.0, (), None, f"{channel}: noise only"))
            continue
        share, signals = predictable(e, log, {n: x[mine] for n, x in features.items()}, rng)
        if signals and share >= PREDICTABLE:
            words = f"{channel}: {100 * share:.0f} % of what is left follows {' and '.join(signals)}"
            found.append(Remainder(channel, size, "predictable", share, signals, None, words))
            continue
        where = localised(e, log, time)
        if where is not None:
            first, last, index = where
            name = problem.logs[index].name
            words = f"{channel}: half of what is left is in {name} between {first:.1f} and {last:.1f} s"
            found.append(Remainder(channel, size, "localised", share, (), (first, last, name), words))
            continue
        words = f"{channel}: a disturbance, {size:.2f} times the noise, that follows none of the logged signals"
        found.append(Remainder(channel, size, "disturbance", share, (), None, words))
    return found


def design(log: np.ndarray, signals: dict[str, np.ndarray]) -> tuple[np.ndarray, list[str]]:
    """Signals, their squares with sign and their lags within a log, standardised."""
    columns, names = [], []
    for name, x in signals.items():
        z = (x - x.mean()) / (x.std() or 1.0)
        for form in (z, z * np.abs(z)):
            for lag in LAGS:
                y = np.roll(form, lag)
                for start in np.flatnonzero(np.diff(log, prepend=-1)):
                    y[start : start + lag] = form[start]
                columns.append(y)
                names.append(name)
    a = np.stack(columns, axis=1)
    return (a - a.mean(axis=0)) / np.maximum(a.std(axis=0), 1e-9), names


def predictable(
    e: np.ndarray, log: np.ndarray, signals: dict[str, np.ndarray], rng: np.random.Generator
) -> tuple[float, tuple[str, ...]]:
    """Share of the energy above the noise that signals predict out of sample, and the two best signals; () if chance may do."""
    a, names = design(log, signals)
    fold = (np.arange(len(e)) * FOLDS // len(e)) if len(np.unique(log)) < 3 else log % FOLDS
    solvers = []
    for k in np.unique(fold):
        train = fold != k
        if not train.any():
            continue
        gram = a[train].T @ a[train] + RIDGE * np.eye(a.shape[1])
        solvers.append((train, ~train, np.linalg.solve(gram, a[train].T)))

    def predicted(y: np.ndarray) -> float:
        return sum(float(y[t] @ y[t] - np.sum((y[t] - a[t] @ (s @ y[r])) ** 2)) for r, t, s in solvers)

    own = predicted(e)
    chance = max(predicted(np.roll(e, int(s))) for s in rng.integers(len(e) // 10, len(e) - len(e) // 10, SHIFTS))
    share = own / max(float(e @ e) - len(e), 1.0)
    if own <= max(chance, 0.0):
        return max(share, 0.0), ()
    alone = {}
    for name in signals:
        columns = [i for i, n in enumerate(names) if n == name]
        b = a[:, columns]
        fit = b @ np.linalg.solve(b.T @ b + RIDGE * np.eye(len(columns)), b.T @ e)
        alone[name] = float(fit @ fit)
    best = sorted(alone, key=lambda n: -alone[n])
    keep = [n for n in best[:2] if alone[n] > 0.5 * alone[best[0]]]
    return min(share, 1.0), tuple(keep)


def localised(e: np.ndarray, log: np.ndarray, time: np.ndarray) -> tuple[float, float, int] | None:
    """The shortest span of one log that holds half of the energy above the noise, if it is short against all."""
    surplus = np.maximum(e**2 - 1.0, 0.0)
    total, n, best = surplus.sum(), len(e), None
    for i in np.unique(log):
        x, t = np.cumsum(np.append(0.0, surplus[log == i])), time[log == i]
        if x[-1] < 0.5 * total:
            continue
        end = np.searchsorted(x, x[:-1] + 0.5 * total)
        inside = end < len(x)
        spans = np.where(inside, end - np.arange(len(end)), n)
        k = int(np.argmin(spans))
        if best is None or spans[k] < best[0]:
            best = (int(spans[k]), float(t[k]), float(t[min(end[k], len(t)) - 1]), int(i))
    if best is None or best[0] > LOCAL * n:
        return None
    return best[1], best[2], best[3]
