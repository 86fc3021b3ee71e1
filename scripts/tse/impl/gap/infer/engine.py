"""The likeliest unknowns: Gauss-Newton with damping and bounds, the discrepancies found
anew as the residuals shrink; and what their covariance is, from the information of the
logs and from how far pieces of them contradict each other."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from scipy.linalg import cholesky, solve_triangular
from scipy.optimize import lsq_linear

from tse.impl.identify.discrepancy import Discrepancy, Piece, without_bias

MOST_STEPS = 40  # of a fit
SETTLED = 0.1  # posterior sd: a step below it ends the search,
LITTLE = 0.1  # nats: or one that is expected to gain less
LEAST_GAIN = 0.25  # of the gain that slopes predict: below it they are simulated anew, or the step is damped
# posterior sd: from a step below it on the discrepancies are free. A prior of the slow
# part's size in its place does not do: far from a fit residuals gain more by what follows
# them than a half-normal of 0.05 m/s2 takes, of less than roads have
NEAR = 1.0
SAME = 1.0  # nats: discrepancies that are no more likely than those before are kept, so that the search can end
MOST_REFITS = 12  # of the discrepancies
WINDOW = 15.0  # s: pieces that are asked separately how far they contradict each other


class Problem(Protocol):
    """What is fitted: unknowns with a normal prior and bounds, residuals by group (log,
    channel) with their slopes, and what is known of discrepancies."""

    power: Mapping[str, float]  # by channel: how much the likelihood counts
    names: Sequence[str]
    mean: np.ndarray
    sd: np.ndarray
    information: np.ndarray
    low: np.ndarray
    high: np.ndarray
    logs: Sequence
    groups: list[tuple[int, str]]
    time: list[np.ndarray]
    channels: Sequence[str]

    def residuals(self, x: np.ndarray) -> list[np.ndarray]: ...

    def slopes(self, x: np.ndarray, base: list[np.ndarray]) -> list[np.ndarray]: ...

    def piece(self, g: int, residual: np.ndarray) -> Piece: ...

    def one_at_speed(self, g: int) -> np.ndarray: ...  # a yaw rate of 1 m/s2 across, in the unit of the residuals

    def pieces(self, residuals: list[np.ndarray], channel: str) -> list[Piece]: ...

    def found(self, pieces: Sequence[Piece], start: Discrepancy | None, far: bool) -> Discrepancy: ...

    def cost(self, d: Discrepancy, pieces: Sequence[Piece]) -> float: ...


@dataclass
class Fit:
    """Where the search stands, or ended."""

    x: np.ndarray
    noise: dict[str, Discrepancy]
    covariance: np.ndarray
    converged: bool = False
    steps: int = 0
    moved: float = np.inf  # posterior sd, in the last step
    residuals: list[np.ndarray] = field(default_factory=list)  # at x
    slopes: list[np.ndarray] = field(default_factory=list)  # whitened, at x


def whitened(
    problem: Problem, noise: dict[str, Discrepancy], residuals: list[np.ndarray], slopes: list[np.ndarray] | None = None
) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Residuals and slopes of each group in units of their own uncertainty, less what the
    bias of the group explains."""
    white_r, white_j = [], []
    for g, (_, channel) in enumerate(problem.groups):
        piece = problem.piece(g, residuals[g])
        columns = np.column_stack([residuals[g], piece.bias] + ([slopes[g]] if slopes is not None else []))
        z = noise[channel].whiten(piece, columns)[0]
        z = problem.power[channel] ** 0.5 * without_bias(np.delete(z, 1, axis=1), z[:, 1])
        white_r.append(z[:, 0])
        white_j.append(z[:, 1:])
    return white_r, white_j


def half_square(problem: Problem, noise: dict[str, Discrepancy], x: np.ndarray, residuals: list[np.ndarray]) -> float:
    """What the search makes small, with the discrepancies as they are."""
    away = x - problem.mean
    far = sum(float(np.einsum("i,i", r, r)) for r in whitened(problem, noise, residuals)[0])
    return 0.5 * (far + float(away @ problem.information @ away))


def discrepancies(
    problem: Problem, residuals: list[np.ndarray], before: dict[str, Discrepancy], far: bool
) -> tuple[dict[str, Discrepancy], float]:
    """Those of all channels, and by how much likelier [nats] they make the residuals than
    those before. `far`: from a fit."""
    now = {c: problem.found(problem.pieces(residuals, c), before.get(c), far) for c in problem.channels}
    if not before:
        return now, np.inf
    pieces = {c: problem.pieces(residuals, c) for c in now}
    better = sum(problem.cost(before[c], pieces[c]) - problem.cost(now[c], pieces[c]) for c in now)
    return now, better


def step(information: np.ndarray, gradient: np.ndarray, damping: float, x: np.ndarray, problem: Problem) -> np.ndarray:
    """Where to go: the least of the damped quadratic within the bounds."""
    scale = 1.0 / np.sqrt(np.diag(information))
    root = cholesky(information * np.outer(scale, scale) + damping * np.eye(len(x)))  # root' root
    target = -solve_triangular(root, gradient * scale, trans="T")
    bounds = ((problem.low - x) / scale - 1e-12, (problem.high - x) / scale + 1e-12)
    return np.clip(x + scale * lsq_linear(root, target, bounds, method="bvls").x, problem.low, problem.high)


def fit(
    problem: Problem,
    x: np.ndarray | None = None,
    noise: dict[str, Discrepancy] | None = None,
    say: Callable[[str], None] = lambda _: None,
    most: int | None = None,
    chords: bool = False,
) -> Fit:
    """Search from the prior, or from `x` and discrepancies `noise`. `most`: steps; None: MOST_STEPS.

    Slopes are simulated at the start, where a step gains much less than they predict, and
    where the search would end; between they follow what the steps have shown (Broyden
    1965). `chords`: where it would end they are only simulated for the covariance. A
    search from the prior begins with discrepancies that cannot follow the car (`far`):
    until it is near."""
    most = MOST_STEPS if most is None else most
    x = np.clip(problem.mean, problem.low, problem.high) if x is None else x
    far, noise, steps, refits, damping = noise is None, dict(noise or {}), 0, 0, 1e-3
    residuals = problem.residuals(x)
    converged, moved, changed = False, np.inf, np.inf
    steep, exact, due = problem.slopes(x, residuals), True, False
    while True:
        if refits < MOST_REFITS and changed > SAME:
            noise, changed = discrepancies(problem, residuals, noise, far)
            refits += 1
        ends = converged or steps >= most
        if not exact and (due or ends):
            steep, exact = problem.slopes(x, residuals), True
        r, j = whitened(problem, noise, residuals, steep)
        information = sum(a.T @ a for a in j) + problem.information
        if ends:
            break
        gradient = sum(a.T @ b for a, b in zip(j, r, strict=True)) + problem.information @ (x - problem.mean)
        here = half_square(problem, noise, x, residuals)
        for _ in range(10):
            there = step(information, gradient, damping, x, problem)
            new = problem.residuals(there)
            gain = here - half_square(problem, noise, there, new)
            if gain > 0 or not exact:
                break
            damping = max(10 * damping, 1e-3)
        if not gain > 0:
            due = not exact
            if not due:  # nowhere to go
                converged = not far and (changed <= SAME or refits >= MOST_REFITS)
                far, changed, steps = False, SAME if converged else np.inf, steps + 1
            continue
        by = there - x
        moved = float(np.max(np.abs(by) / np.sqrt(np.diag(np.linalg.inv(information)))))
        expected = -float(gradient @ by + 0.5 * by @ information @ by)
        good, settled = gain > LEAST_GAIN * expected, moved < SETTLED or expected < LITTLE
        if good or exact:
            damping = max(damping / 10, 1e-6) if good else max(10 * damping, 1e-2)
        due = not exact and (not good or (settled and not chords))
        steep, exact = _followed(steep, residuals, new, by / problem.sd, problem.sd), exact and settled
        x, residuals, steps = there, new, steps + 1
        converged = settled and not (far or due) and (changed <= SAME or refits >= MOST_REFITS)
        if (moved < NEAR if far else settled and not due) and not converged:
            far, changed = False, np.inf
        say(f"step {steps}: the largest change is {moved:.2g} sd")
    return Fit(x, noise, covariance(problem, information, r, j), converged, steps, moved, residuals, j)


def _followed(
    slopes: list[np.ndarray], before: list[np.ndarray], after: list[np.ndarray], by: np.ndarray, unit: np.ndarray
) -> list[np.ndarray]:
    """Slopes that agree with what a step did: the least change of them in units of the
    unknowns. `by`: the step in these."""
    along = by / max(float(by @ by), 1e-300)
    return [t + np.outer(b - a - t @ (by * unit), along / unit) for t, a, b in zip(slopes, before, after, strict=True)]


def covariance(problem: Problem, information: np.ndarray, r: list[np.ndarray], j: list[np.ndarray]) -> np.ndarray:
    """Inverse information, made wider where pieces of WINDOW of the logs ask for more
    different things than chance allows: the model is then wrong in a way that no
    discrepancy of the channels stands for (sandwich: White 1982)."""
    bread = np.linalg.inv(information)
    meat = problem.information.copy()
    for i in range(len(problem.logs)):
        scores: dict[int, np.ndarray] = {}
        for g in (g for g, (log, _) in enumerate(problem.groups) if log == i):
            window = (problem.time[g] // WINDOW).astype(int)
            for w in np.unique(window):
                rows = window == w
                scores[w] = scores.get(w, np.zeros(len(bread))) + j[g][rows].T @ r[g][rows]
        for score in scores.values():
            meat += np.outer(score, score)
    wide = bread @ meat @ bread
    widening = np.sqrt(np.maximum(np.diag(wide) / np.diag(bread), 1.0))
    return bread * np.outer(widening, widening)
