"""Estimate car and road by maximum a posteriori: Gauss-Newton on robust least squares.

The cost is minimised over x and z. x contains the unknowns of the car, the lean of the
roads (share of the lateral acceleration in curves that their bank compensates) and the
biases of the channels, see problem.py. z contains bank and grade at the knots of the
roads, see knots.py. The cost is
    sum over residuals e of rho(e)/sd^2
    + 1/2 (x - mean)' information (x - mean) + 1/2 z'z/KNOT_SD^2.
rho is the Huber loss (quadratic up to HUBER), and 1/sd^2 the weight of a residual, see
measure_scales(). mean and information describe the prior of x. In each step z is
eliminated: the information matrix of z is banded, and one sparse factorisation gives the
Schur complement, a system of equations for x alone.

A residual is white sensor noise plus a model error that is correlated over MODEL_TIME. So
all model errors within MODEL_TIME have the weight of a single one. This increases the
covariance of x, and hardly changes the estimate of x.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import cholesky, solve_triangular
from scipy.optimize import lsq_linear
from scipy.sparse import csc_matrix, diags, identity
from scipy.sparse.linalg import splu

from tse.identify.problem import CarProblem

HUBER = 4.0  # [rms of the channel's residuals] residual above which the loss is linear, not quadratic
MODEL_TIME = 2.0  # [s] correlation time of the model error
MAX_FIT_STEPS = 40
MAX_STEP_SD = 1.5  # [prior sd] largest change of an unknown in one step
# If (rms of the residuals after a step / rms before it) exceeds this ratio in each
# channel, the maximum of the posterior density is near. From then on, residuals are
# weighted as correlated (see fit())
NEAR_RATIO = 0.9
MAX_FINAL_STEP = 0.1  # [posterior sd] a step that changes no unknown by more ends the search
MIN_GAIN_NATS = 0.1  # [nat] a step with a smaller predicted gain (reduction of the cost) ends the search
# ratio of gain to predicted gain; after a step with a smaller ratio, partial derivatives
# are simulated again instead of only being updated
MIN_GAIN_SHARE = 0.25
MAX_HALVINGS = 6  # number of lengths of a step that are tried, each half as long as the one before


@dataclass(frozen=True)
class ResidualScale:
    """Rms of the residuals of a channel, and the sd that determines their weight.

    Both have the unit of the residuals.
    """

    rms: float  # root mean square, with outliers clipped
    sd: float  # a residual has the weight 1/sd^2; sd is larger than rms if residuals are correlated


@dataclass
class CarFit:
    """State of the search, or its result.

    Attributes
    ----------
    x, covariance
        Estimate of the unknowns, and its covariance. A stiffness is given as
        ln(stiffness / stiffness in the vehicle file).
    z
        Values of bank and grade [rad].
    search
        x in the coordinates of the search: cornering stiffnesses are replaced by their
        inverses.
    scales
        Rms of the residuals, and the sd that determines their weight. Key: channel.
    residuals, slopes, equations
        At the estimate: residuals, their partial derivatives with respect to `search` and
        to `z`, and normal equations for the step of `search`.
    converged
        True: the search has found the maximum of the posterior density. False: it stopped
        at the limit of steps.
    steps, moved
        Number of steps, and largest change of an unknown in the last step [posterior sd].
    level
        Residuals at x if bank and grade are 0.
    """

    x: np.ndarray
    z: np.ndarray
    covariance: np.ndarray
    search: np.ndarray
    scales: dict[str, ResidualScale]
    residuals: list[np.ndarray]
    slopes: tuple[list[np.ndarray], list[csc_matrix]]
    equations: NormalEquations
    converged: bool = False
    steps: int = 0
    moved: float = np.inf
    level: list[np.ndarray] = field(default_factory=list)


def measure_scales(
    problem: CarProblem,
    residuals: list[np.ndarray],
    before: Mapping[str, ResidualScale] | None = None,
    near: bool = True,
) -> dict[str, ResidualScale]:
    """Return for each channel the rms of its residuals and the sd that sets their weight.

    Parameters
    ----------
    problem
        Has the noise of the channels.
    residuals
        One vector for each channel of each log, in the order of problem.groups.
    before
        Result of this function before the last step. Residuals are clipped at HUBER times
        the rms in `before`, so that outliers do not increase the new rms. None: they are
        clipped at HUBER times 1.48 median |residual|. In both cases, the limit is at
        least HUBER times the sd of the sensor noise.
    near
        True: the search is near the maximum of the posterior density. False: residuals
        are much larger than at the maximum, and are weighted as if they were independent
        (sd = rms).

    Notes
    -----
    rms^2 = noise^2 + model^2, with the sd `noise` of the white sensor noise and the sd
    `model` of the model error. The MODEL_TIME/dt model errors within MODEL_TIME (dt: time
    between values) have the weight of one: sd^2 = noise^2 + model^2 MODEL_TIME/dt.

    `model` has a lower limit, see compute_lasting_error(). For accel_y and yaw_rate it is
    MIN_MODEL_ERROR times the rms of the signal. Without the limit, `model` could become 0
    and the confidence intervals too narrow, although the model of a real car has errors.
    """
    found: dict[str, ResidualScale] = {}
    for c in problem.channels:
        mine = [g for g, (_, channel) in enumerate(problem.groups) if channel == c]
        e = np.concatenate([residuals[g] for g in mine])
        size = before[c].rms if before else 1.4826 * float(np.median(np.abs(e)))
        noises, counts = [problem.compute_noise(g) ** 2 for g in mine], [len(residuals[g]) for g in mine]
        noise = float(np.sqrt(np.average(noises, weights=counts)))
        rms = float(np.sqrt(np.mean(np.minimum(np.abs(e), HUBER * max(size, noise)) ** 2)))
        rms = max(rms, float(np.hypot(noise, problem.compute_lasting_error(c))), 1e-9)
        share = min(1.0, (noise / rms) ** 2) if near else 1.0
        values = max(1.0, MODEL_TIME / problem.get_step(mine[0]))
        found[c] = ResidualScale(rms, rms * float(np.sqrt(share + (1.0 - share) * values)))
    return found


def compute_cost(
    problem: CarProblem,
    scales: Mapping[str, ResidualScale],
    x: np.ndarray,
    z: np.ndarray,
    residuals: list[np.ndarray],
) -> float:
    """Return the cost that the search minimises (see the top of this file).

    `scales` has rms and weight of the residuals, from measure_scales(). `residuals` are
    the residuals at x and z.
    """
    away = x - problem.mean
    total = 0.5 * float(away @ problem.information @ away) + 0.5 * float(z @ z) / problem.knot_sd**2
    for e, (_, c) in zip(residuals, problem.groups, strict=True):
        end = HUBER * scales[c].rms
        a = np.abs(e)
        total += float(np.where(a <= end, 0.5 * a * a, end * (a - 0.5 * end)).sum()) / scales[c].sd ** 2
    return total


@dataclass
class NormalEquations:
    """Normal equations of the search at a point (x, z), reduced to equations for x alone.

    x has the unknowns of the car, z the bank and grade of the roads (see the top of this
    file). z is eliminated by the Schur complement.
    """

    information: np.ndarray  # information matrix of x, after the elimination of z
    gradient: np.ndarray  # gradient of the cost with respect to x, after the elimination of z
    across: np.ndarray  # (length of z, length of x) mixed second derivatives of the cost
    own: np.ndarray  # gradient of the cost with respect to z
    factor: object | None  # factorised information matrix of z; None: the road is not fitted

    def solve_road(self, step: np.ndarray) -> np.ndarray:
        """Return the step of z that minimises the cost for a given step of x."""
        if self.factor is None:
            return np.zeros(0)
        return -self.factor.solve(self.own + self.across @ step)

    def compute_road_evidence(self, values: slice, z: np.ndarray, prior_sd: float) -> float:
        """Return the evidence [nat] that some values of bank or grade differ from 0.

        It is the ln of the Savage-Dickey ratio: prior density divided by posterior
        density of these values at 0, with x and all other values marginalised. `values`
        selects them in z, and `prior_sd` is the prior sd of each of them.
        """
        if self.factor is None:
            return 0.0
        chosen = np.zeros((len(z), values.stop - values.start))
        chosen[values] = np.eye(chosen.shape[1])
        inner = self.factor.solve(chosen)
        along = inner.T @ self.across
        covariance = inner[values] + along @ np.linalg.solve(self.information, along.T)
        root = np.linalg.cholesky(covariance)
        away = np.linalg.solve(root, z[values])
        return float(0.5 * away @ away + np.log(np.diag(root)).sum() - len(away) * np.log(prior_sd))

    def compute_road_sd(self) -> np.ndarray:
        """Return the posterior sd [rad] of each value of z, with x marginalised."""
        if self.factor is None:
            return np.zeros(0)
        inner = self.factor.solve(np.eye(len(self.own)))
        along = inner @ self.across
        by_car = np.einsum("ij,ji->i", along, np.linalg.solve(self.information, along.T))
        return np.sqrt(np.diag(inner) + by_car)


def build_normal(
    problem: CarProblem,
    scales: Mapping[str, ResidualScale],
    x: np.ndarray,
    z: np.ndarray,
    residuals: list[np.ndarray],
    tables: list[np.ndarray],
    roads: list[csc_matrix],
    channels: Collection[str] | None = None,
) -> NormalEquations:
    """Build the normal equations from residuals and their partial derivatives.

    Parameters
    ----------
    problem, scales
        Prior of x, and scales of the residuals from measure_scales().
    x, z
        Point of the linearisation.
    residuals, tables, roads
        Residuals at this point, and their partial derivatives with respect to x and to z:
        one array or matrix for each channel of each log, in the order of problem.groups.
    channels
        Channels whose residuals are used; None: all.
    """
    information = problem.information.copy()
    gradient = problem.information @ (x - problem.mean)
    size = len(z)
    across = np.zeros((size, len(x)))
    own = z / problem.knot_sd**2
    inner = identity(size, format="csc") / problem.knot_sd**2 if size else None
    for e, j, r, (_, c) in zip(residuals, tables, roads, problem.groups, strict=True):
        if channels is not None and c not in channels:
            continue
        weight = np.minimum(1.0, HUBER * scales[c].rms / np.maximum(np.abs(e), 1e-300)) / scales[c].sd ** 2
        weighted = weight[:, None] * j
        information += j.T @ weighted
        gradient += weighted.T @ e
        if size:
            across += r.T @ weighted
            own += r.T @ (weight * e)
            inner = inner + r.T @ (diags(weight) @ r)
    if not size:
        return NormalEquations(information, gradient, across, own, None)
    factor = splu(inner.tocsc())
    solved = factor.solve(np.column_stack([across, own]))
    return NormalEquations(
        information - across.T @ solved[:, :-1], gradient - across.T @ solved[:, -1], across, own, factor
    )


def compute_step(problem: CarProblem, equations: NormalEquations, x: np.ndarray) -> np.ndarray:
    """Return the Gauss-Newton step of x, within the bounds and MAX_STEP_SD."""
    scale = 1.0 / np.sqrt(np.diag(equations.information))
    root = cholesky(equations.information * np.outer(scale, scale))  # upper triangular; root' root = argument
    target = -solve_triangular(root, equations.gradient * scale, trans="T")
    low = np.maximum(problem.low - x, -MAX_STEP_SD * problem.sd)
    high = np.minimum(problem.high - x, MAX_STEP_SD * problem.sd)
    found = scale * lsq_linear(root, target, (low / scale - 1e-12, high / scale + 1e-12), method="bvls").x
    return np.clip(found, low, high)


def fit(
    problem: CarProblem,
    x: np.ndarray | None = None,
    z: np.ndarray | None = None,
    say: Callable[[str], None] = lambda _: None,
    max_steps: int | None = None,
    near: bool = False,
    tables: list[np.ndarray] | None = None,
) -> CarFit:
    """Search for the maximum a posteriori estimate of car and road.

    Parameters
    ----------
    problem
        Residuals and prior.
    x, z
        Start of the search, with x in the coordinates of CarFit.search. None: mean of
        the prior.
    say
        Called after each step with a line about the progress.
    max_steps
        Maximum number of steps; None: MAX_FIT_STEPS.
    near
        True: the start is near the maximum, so its residuals are weighted as correlated.
    tables
        Partial derivatives with respect to x at the start, if they are known. The search
        may then end without simulating them. To be given only if bank and grade are
        known, i.e. z is empty.

    Notes
    -----
    Until the maximum is near, residuals are weighted as independent (measure_scales()).
    Weighted as correlated, the large residuals far from the maximum would give the logs
    too little weight against the prior, and x would hardly leave the start.

    Partial derivatives by finite differences need a simulation of all logs for each of
    about fifty unknowns, which is nearly all of the computing time. They are simulated at
    the start, after a step that gains much less than predicted, and at the end. After
    all other steps they are updated (Broyden 1965).
    """
    x = np.clip(problem.mean, problem.low, problem.high) if x is None else x
    z = np.zeros(problem.knots) if z is None else z
    residuals = problem.compute_residuals(x, z)
    rough = tables is not None
    scales = measure_scales(problem, residuals, near=near)
    if rough:
        roads = problem.compute_road_slopes(x, z, residuals)
    else:
        tables, roads = problem.compute_slopes(x, z, residuals), problem.compute_road_slopes(x, z, residuals)
    if len(z):
        hills = _fit_road(problem, scales, x, z, residuals, tables, roads)
        if hills is not None:
            z, residuals = hills
            scales = measure_scales(problem, residuals, scales, near)
    exact, converged, moved, steps = True, False, np.inf, 0
    max_steps = MAX_FIT_STEPS if max_steps is None else max_steps
    while True:
        equations = build_normal(problem, scales, x, z, residuals, tables, roads)
        if converged or steps >= max_steps:
            break
        here = compute_cost(problem, scales, x, z, residuals)
        whole = compute_step(problem, equations, x)
        for halving in range(MAX_HALVINGS):
            there = np.clip(x + whole * 0.5**halving, problem.low, problem.high)
            by = there - x
            along = equations.solve_road(whole) * 0.5**halving
            new = problem.compute_residuals(there, z + along)
            gain = here - compute_cost(problem, scales, there, z + along, new)
            if gain > 0 or not exact:
                break
        expected = _predict_gain(problem, scales, x, z, residuals, tables, roads, by, along)
        moved = float(np.max(np.abs(by) / np.sqrt(np.diag(np.linalg.inv(equations.information)))))
        settled = moved < MAX_FINAL_STEP or expected < MIN_GAIN_NATS
        converged = near and (exact or rough) and (settled or gain <= 0)
        if gain > 0:
            tables = _update_slopes(problem, tables, roads, residuals, new, by, along)
            x, z, residuals = there, z + along, new
            steps += 1
            say(f"step {steps}: the largest change of an unknown is {moved:.2g} posterior sd")
        exact = not converged and ((near and settled) or gain < MIN_GAIN_SHARE * expected)
        if exact:
            tables, roads = (
                problem.compute_slopes(x, z, residuals),
                problem.compute_road_slopes(x, z, residuals),
            )
        before, scales = scales, measure_scales(problem, residuals, scales, near)
        near = near or (gain > 0 and all(scales[c].rms > NEAR_RATIO * before[c].rms for c in scales))
    ln = problem.compute_ln_slope(x)
    covariance = np.linalg.inv(equations.information) * np.outer(ln, ln)
    return CarFit(
        problem.to_ln(x), z, covariance, x, scales, residuals, (tables, roads), equations,
        converged, steps, moved,
        problem.compute_residuals(x, np.zeros(len(z))) if len(z) else residuals,
    )  # fmt: skip


def _fit_road(
    problem: CarProblem,
    scales: Mapping[str, ResidualScale],
    x: np.ndarray,
    z: np.ndarray,
    residuals: list[np.ndarray],
    tables: list[np.ndarray],
    roads: list[csc_matrix],
) -> tuple[np.ndarray, list[np.ndarray]] | None:
    """Fit the road for a fixed x; return z and residuals, or None if the cost rises.

    The search begins with this fit. Without it, the first step of x would change
    latencies and stiffnesses to explain the effect of a hill.
    """
    equations = build_normal(problem, scales, x, z, residuals, tables, roads)
    hills = z + equations.solve_road(np.zeros(len(x)))
    on_hills = problem.compute_residuals(x, hills)
    gain = compute_cost(problem, scales, x, z, residuals)
    gain -= compute_cost(problem, scales, x, hills, on_hills)
    return (hills, on_hills) if gain > 0 else None


def _predict_gain(
    problem: CarProblem,
    scales: Mapping[str, ResidualScale],
    x: np.ndarray,
    z: np.ndarray,
    residuals: list[np.ndarray],
    tables: list[np.ndarray],
    roads: list[csc_matrix],
    by: np.ndarray,
    along: np.ndarray,
) -> float:
    """Return the reduction of the cost that the partial derivatives predict for a step.

    The step is `by` in x and `along` in z.
    """
    there = [e + j @ by + r @ along for e, j, r in zip(residuals, tables, roads, strict=True)]
    return compute_cost(problem, scales, x, z, residuals) - compute_cost(
        problem, scales, x + by, z + along, there
    )


def _update_slopes(
    problem: CarProblem,
    tables: list[np.ndarray],
    roads: list[csc_matrix],
    before: list[np.ndarray],
    after: list[np.ndarray],
    by: np.ndarray,
    along: np.ndarray,
) -> list[np.ndarray]:
    """Update partial derivatives so that they predict the residuals after a step.

    Of all such updates, Broyden's is the smallest, with each unknown of x in units of its
    prior sd. The step is `by` in x and `along` in z. `before` and `after` are the
    residuals before and after the step.
    """
    unit = by / problem.sd**2
    size = max(float(by @ unit), 1e-300)
    return [
        j + np.outer(b - a - j @ by - r @ along, unit / size)
        for j, r, a, b in zip(tables, roads, before, after, strict=True)
    ]


def compute_covariance(problem: CarProblem, fit: CarFit, channels: Collection[str]) -> np.ndarray:
    """Return the covariance of x that the fit would have if it used only `channels`."""
    equations = build_normal(problem, fit.scales, fit.search, fit.z, fit.residuals, *fit.slopes, channels)
    ln = problem.compute_ln_slope(fit.search)
    return np.linalg.inv(equations.information) * np.outer(ln, ln)
