"""What is left after naming: can it be predicted from logged signals, is it somewhere in time, or is it just there?

Predictable: a ridge regression on signals, their squares and lags is fitted to the residual on some logs (or parts) and
asked about the others. Chance is measured by the same regression on the residual shifted in time, in a circle.
Localised: how few seconds hold half of the energy above the noise.
What none of that is may still be the sensors': noise in a band that row to row differences do not see, a bias that walks.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from tselab.gap.data import BLOCK, CHANNELS
from tselab.gap.problem import Problem

LAGS = (0, 2, 5, 10)  # blocks: of the signals that a residual may follow
FOLDS = 5  # of the cross-validation
SHIFTS = 39  # in a circle, by which chance is measured; the largest of 39 is 1 in 40: a p value of 0.025
RIDGE = 30.0  # of the regression on standardised signals, in blocks
PREDICTABLE = 0.15  # of the energy above the noise that must be predicted to be worth words
LOCAL = 0.15  # of the time: half of the energy in less is localised
WALK = {"accel_x": 0.005, "accel_y": 0.005, "yaw_rate": 0.0003}  # m/s2, rad/s per root s: how far MEMS biases walk
MEMORY = 0.12  # s: cars and roads remember longer than the low pass of a sensor


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


def remainder(
    problem: Problem, residuals: np.ndarray, features: dict[str, np.ndarray], limit: float
) -> list[Remainder]:
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
        steady = without_walk(without_spikes(e, log), log, walk(problem, mine, channel))
        if np.sqrt(np.mean(steady**2)) <= limit:
            words = f"{channel}: noise only, besides lone spikes or a bias that walks"
            found.append(Remainder(channel, size, "noise", 0.0, (), None, words))
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
        words = f"{channel}: a disturbance, {size:.2f} times the noise, that follows no logged signal by itself"
        found.append(Remainder(channel, size, "disturbance", share, (), None, words))
    return found


def noisier(problem: Problem, residuals: np.ndarray, limit: float) -> dict[str, float]:
    """Channels of which the residual is noise, though larger than was measured, and how many times."""
    found = {}
    for c in np.unique(problem.rows.channel):
        mine = (problem.rows.channel == c) & (problem.weight > 0)
        e, log, channel = residuals[mine], problem.rows.log[mine], CHANNELS[c]
        steady = without_walk(without_spikes(e, log), log, walk(problem, mine, channel))
        size = float(np.sqrt(np.mean(steady**2)))
        if size > limit and is_noise(steady, log):
            found[channel] = size
    return found


def walk(problem: Problem, rows: np.ndarray, channel: str) -> float:
    """How far the bias of a channel walks in a block, in units of the block's noise."""
    return WALK.get(channel, 0.0) * float(np.sqrt(BLOCK) * np.median(problem.weight[rows]))


def without_spikes(e: np.ndarray, log: np.ndarray) -> np.ndarray:
    """The residual with lone blocks far out put back among their neighbours: cars do not jump there and back within 40 ms."""
    near = 3.0 * 1.4826 * float(np.median(np.abs(e)))
    calm = np.abs(e) < near
    inside = np.append(False, (log[2:] == log[1:-1]) & (log[1:-1] == log[:-2])) if len(e) > 2 else np.zeros(0, bool)
    lone = np.flatnonzero(np.append(inside, False)[: len(e)])
    lone = lone[~calm[lone] & calm[lone - 1] & calm[lone + 1] & (np.abs(e[lone]) > 1.25 * near)]
    rest = e.copy()
    rest[lone] = 0.5 * (e[lone - 1] + e[lone + 1])
    return rest


def without_walk(e: np.ndarray, log: np.ndarray, step: float) -> np.ndarray:
    """The residual less a bias that walks by `step` a block, as a smoother finds it in white noise of size one."""
    if step <= 0:
        return e
    # steady gain of the Kalman filter of a walk, forwards, then backwards
    g = 0.5 * step * (np.sqrt(step**2 + 4.0) - step)
    rest = np.empty_like(e)
    for i in np.unique(log):
        x = e[log == i]
        forth, _ = lfilter([g], [1.0, g - 1.0], x, zi=[(1.0 - g) * x[: max(1, round(1.0 / g))].mean()])
        back, _ = lfilter([g], [1.0, g - 1.0], forth[::-1], zi=[(1.0 - g) * forth[-1]])
        rest[log == i] = x - back[::-1]
    return rest


def is_noise(e: np.ndarray, log: np.ndarray) -> bool:
    """Always there in the same size, soon forgotten, no oscillation: what sensors with a low pass have. What a car or a road does
    comes and goes with driving, lasts, or swings."""
    most = round(1.0 / BLOCK)
    c, energies = np.zeros(most + 1), []
    for i in np.unique(log):
        x = e[log == i] - e[log == i].mean()
        c += [x[: len(x) - k] @ x[k:] for k in range(most + 1)]
        energies += [float(np.mean(s**2)) for s in np.split(x, range(most, len(x), most)) if len(s) == most]
    rho = c[1:] / max(c[0], 1e-300)
    limit = 3.0 / np.sqrt(len(e))
    length = 1.0 + 2.0 * float(np.sum(np.where(np.cumprod(rho > limit), rho, 0.0)))
    calm = max(1, round(MEMORY / BLOCK))
    if length * BLOCK > MEMORY or np.abs(rho[calm:]).max() > 0.1 + limit or rho.min() < -0.1 - limit:
        return False
    chance = 2.0 * (1.0 + 2.0 * float(rho @ rho)) / most  # variance of the energy of a second over its mean's square
    return float(np.var(energies)) <= 2.0 * chance * float(np.mean(energies)) ** 2


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
