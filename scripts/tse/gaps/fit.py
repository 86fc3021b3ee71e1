"""Fit stiffness and effect parameters to logs by least squares, and compare two fits by
the ratio of residual rms to sensor noise, with paired block-bootstrap intervals. Two fits
can also be compared on logs to which they were not fitted.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from tse.gaps.catalogue import CatalogueParameter, Key
from tse.gaps.problem import Problem
from tse.identify.data import BLOCK_TIME

# Max ratio of residual rms to sensor noise at which the model counts as explaining a
# channel. It is above 1, because the noise is known only to a few percent, and because
# the inputs of the simulation are smoothed: the fast parts of the motion that the
# smoothing removes remain in the residuals.
NOISE_LIMIT = 1.2
MAX_LAG = 4.0  # [s] largest lag for which autocorrelations are computed
TOLERANCE = 0.0001  # relative change of the sum of squares below which a fit ends
TOGETHER = 2.0  # [s] length of the blocks of residuals that the bootstrap resamples
DRAWS = 1000  # number of bootstrap samples
SEED = 1  # seed of the bootstrap


@dataclass
class Fit:
    """A fitted model."""

    parameters: list[CatalogueParameter]  # the fitted parameters
    values: dict[Key, float]
    residuals: np.ndarray  # whitened residuals at these values
    # partial derivatives of the residuals (rows) with respect to the parameters (columns)
    jacobian: np.ndarray


def fit_parameters(
    problem: Problem,
    parameters: Sequence[CatalogueParameter],
    start: Mapping[Key, float],
    most: int = 12,
    tolerance: float = TOLERANCE,
) -> Fit:
    """Fit the parameters by least squares. A parameter with a prior adds the residual
    (value - default) / prior sd.

    A parameter starts at its value in `start`. If `start` has no value for the parameter,
    it starts at its default. The fit ends after at most `most` evaluations of the
    residuals, or if the relative change of the sum of squares is below `tolerance`.
    """
    parameters = list(parameters)
    low, high = np.array([p.low for p in parameters]), np.array([p.high for p in parameters])
    scale = np.array([p.scale for p in parameters])
    x0 = np.clip([start.get(p.name, p.default) for p in parameters], low + 1e-6 * scale, high - 1e-6 * scale)

    def values(x: np.ndarray) -> dict[Key, float]:
        return {p.name: float(v) for p, v in zip(parameters, x, strict=True)}

    prior = np.array([1.0 / p.prior if p.prior else 0.0 for p in parameters])
    default = np.array([p.default for p in parameters])
    known = prior > 0
    last: dict[str, np.ndarray] = {}

    def residuals(x: np.ndarray) -> np.ndarray:
        last["x"], last["r"] = x.copy(), problem.compute_residuals(values(x))
        return np.append(last["r"], ((x - default) * prior)[known])

    def jacobian(x: np.ndarray) -> np.ndarray:
        if not np.array_equal(last.get("x"), x):
            residuals(x)
        return np.vstack([problem.compute_jacobian(values(x), last["r"], parameters), np.diag(prior)[known]])

    # Parameters without influence on the residuals cause divisions by 0 in the solver.
    with np.errstate(divide="ignore", invalid="ignore"):
        result = least_squares(
            residuals,
            x0,
            jacobian,
            bounds=(low, high),
            x_scale=scale,
            ftol=tolerance,
            xtol=1e-5,
            gtol=None,
            max_nfev=most,
        )
    rows = len(result.fun) - int(known.sum())
    if not np.isfinite(result.x).all():  # the fit failed: return the start
        return Fit(parameters, values(x0), residuals(x0)[:rows], jacobian(x0)[:rows])
    return Fit(parameters, values(result.x), result.fun[:rows], result.jac[:rows])


def compute_correlation_lengths(problem: Problem, residuals: np.ndarray) -> dict[str, float]:
    """Return the integrated autocorrelation time of each channel's residuals.

    The autocorrelation time is the number of consecutive, correlated residuals that
    together have the information of one independent residual. It is at least 1. Each
    residual is a mean over BLOCK_TIME.
    """
    found = {}
    for channel, _ in problem.used():
        top = bottom = None
        for group in np.unique(problem.rows.group[problem.rows.of(channel)]):
            x = residuals[problem.rows.group == group]
            n = min(len(x) - 1, int(MAX_LAG / BLOCK_TIME))
            size = 1 << (2 * len(x) - 1).bit_length()
            c = np.fft.irfft(np.abs(np.fft.rfft(x, size)) ** 2, size)[: n + 1]
            c = np.pad(c, (0, int(MAX_LAG / BLOCK_TIME) + 1 - len(c)))
            top = c if top is None else top + c
            bottom = c[0] if bottom is None else bottom + c[0]
        rho = top[1:] / max(bottom, 1e-300)
        # Geyer's initial positive sequence: add the autocorrelations at neighbouring lags
        # in pairs, and sum the pairs before the first one that is not positive.
        pairs = rho[: len(rho) // 2 * 2].reshape(-1, 2).sum(axis=1)
        end = int(np.argmax(pairs <= 0)) if (pairs <= 0).any() else len(pairs)
        found[channel] = max(1.0, 1.0 + 2.0 * float(pairs[:end].sum()))
    return found


def compute_gap(problem: Problem, residuals: np.ndarray) -> dict[str, float]:
    """Return the ratio of residual rms to sensor noise for each channel. The ratio is
    about 1 if the residuals are noise only.
    """
    return {c: float(np.sqrt(np.mean(residuals[rows] ** 2))) for c, rows in problem.used()}


def compute_channel_excess(problem: Problem, residuals: np.ndarray) -> dict[str, float]:
    """Return, for each channel, the sum of squared residuals minus the sum expected from
    sensor noise; 0 if the difference is negative.

    The difference is the gap: the error that the model leaves. The expected square of a
    residual that is only noise is 1, because residuals are divided by the noise sd of
    their channel. The expected square is less than 1 (Problem.noise_energy) if the
    estimated sd was below a lower limit and the limit is used instead.
    """
    return {
        c: max(0.0, float(residuals[rows] @ residuals[rows]) - float(problem.noise_energy[rows].sum()))
        for c, rows in problem.used()
    }


def compute_excess(problem: Problem, residuals: np.ndarray) -> float:
    """Return the gap: the sum of squared residuals minus the sum expected from sensor
    noise, summed over all channels (compute_channel_excess())."""
    return sum(compute_channel_excess(problem, residuals).values())


def compute_covariance(problem: Problem, f: Fit) -> np.ndarray:
    """Return the covariance of the parameters of a fit, with correlated residuals taken
    into account.

    It is a sandwich estimate from the mean square and autocorrelation of each channel's
    residuals. If the model lacks an effect of the car, a covariance from sensor noise
    alone would be 2 to 15 times too small.
    """
    length = compute_correlation_lengths(problem, f.residuals)
    scale = np.zeros(len(f.residuals))
    for channel, t in length.items():
        rows = problem.rows.of(channel)
        scale[rows] = t * np.mean(f.residuals[rows] ** 2)
    prior = np.diag([1.0 / p.prior**2 if p.prior else 0.0 for p in f.parameters])
    bread = np.linalg.pinv(f.jacobian.T @ f.jacobian + prior)
    return bread @ ((f.jacobian.T * scale) @ f.jacobian + prior) @ bread


# ---- comparison of two models


@dataclass(frozen=True)
class ChannelChange:
    """Comparison of the residuals of one channel between a first and a second model."""

    before: float  # ratio of residual rms to sensor noise with the first model
    after: float  # ratio of residual rms to sensor noise with the second model
    change: float  # relative change of the rms, after / before - 1
    ci95: tuple[float, float]  # 95 % interval of `change`

    @property
    def better(self) -> bool:
        return self.ci95[1] < 0.0


def compare_models(problem: Problem, before: np.ndarray, after: np.ndarray) -> dict[str, ChannelChange]:
    """Compare two models, and return channel -> change of the residuals.

    `before` and `after` are the whitened residuals of the first and the second model in
    the same logs. The change is that of the rms of the residuals, after / before - 1. Its
    95 % interval comes from a bootstrap over blocks of the length TOGETHER, with a fixed
    seed. Each bootstrap sample uses the same blocks for both models.
    """
    rng = np.random.default_rng(SEED)
    found = {}
    for c, mine in problem.used():
        key = problem.rows.log[mine] * 10_000_000 + (problem.rows.time[mine] // TOGETHER).astype(np.int64)
        _, index = np.unique(key, return_inverse=True)
        count = np.bincount(index).astype(float)
        e0, e1 = np.bincount(index, before[mine] ** 2), np.bincount(index, after[mine] ** 2)
        draws = rng.integers(0, len(count), (DRAWS, len(count)))
        n0, n1 = e0[draws].sum(axis=1), e1[draws].sum(axis=1)
        ratio = np.sqrt(n1 / np.maximum(n0, 1e-300)) - 1.0
        found[c] = ChannelChange(
            float(np.sqrt(e0.sum() / count.sum())),
            float(np.sqrt(e1.sum() / count.sum())),
            float(np.sqrt(e1.sum() / max(e0.sum(), 1e-300)) - 1.0),
            (float(np.quantile(ratio, 0.025)), float(np.quantile(ratio, 0.975))),
        )
    return found
