"""What is missing, made visible: the disturbance itself over time, and what it follows.

where.entries() says at which place something enters that the model does not have. Here a Kalman smoother shows that something
as a series with its uncertainty; what it follows is sought among inputs and simulated quantities with their signs, for a
friction or a wind shows by its sign, which energies do not have."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import combinations, permutations

import numpy as np
from scipy.linalg import expm
from scipy.sparse import csr_matrix

from tselab.core import Config
from tselab.gap import constants
from tselab.gap.data import BLOCK, BURN_IN, blocks
from tselab.gap.localise.remainder import FOLDS, SHIFTS
from tselab.gap.localise.where import PLACES, SIZES, TIMES, Entry, enters
from tselab.gap.problem import Problem
from tselab.gap.singletrack import SingleTrack

LONGITUDINAL = "longitudinal"
BIAS, FACTORS, BINS, MOST = constants.of(__name__, "BIAS", "FACTORS", "BINS", "MOST")
UNITS = {"speed": "m/s", "steer": "rad", "steer_rate": "rad/s", "accel_x": "m/s2", "accel_y": "m/s2", "yaw_rate": "rad/s",
         "slip_front": "1", "time": "s"}  # fmt: skip


@dataclass(frozen=True)
class Latent:
    """A disturbance at one place. Arrays: one value per entry of the residual vector, the same for all channels of a block; NaN
    where the log has not the channels that show it."""

    place: str
    unit: str
    value: np.ndarray
    sd: np.ndarray


@dataclass(frozen=True)
class Explained:
    """A quantity that a latent disturbance follows."""

    name: str
    share: float  # of the disturbance's variance within logs, out of fold
    shape: np.ndarray  # (bins, 4): middle of the quantity, mean, lower and upper quartile of the disturbance
    unit: str  # of the quantity
    quantity: np.ndarray  # one value per entry of the residual vector
    chance: float  # the share that the best of all quantities gets by chance, 1 in 40


# ---- the disturbance


def latent(problem: Problem, residuals: np.ndarray, values: Mapping[str, float], entry: Entry) -> Latent:
    """The disturbance at entry.place, given all of each log. `residuals`: whitened, of `values` (Problem.residuals).

    Lateral places: of the time constant of `entry`, and of its size to a factor of FACTORS, the likeliest: the sizes that
    where.entries() tries are four times apart, and its filter has no noise within a block, which makes a moment look small; a
    band of half the size holds only 7 of 10 values. "longitudinal": what accel_x alone reads too much, m/s2, the likeliest of
    where's sizes and time constants; those of `entry` are not used. Not in the band: that stiffness is not known exactly."""
    along = entry.place == LONGITUDINAL
    if not along and entry.place not in PLACES:
        raise ValueError(f"there is no place '{entry.place}'")
    rows = problem.rows
    residuals = np.where(problem.weight > 0, residuals, 0.0)
    value, sd = np.full(len(residuals), np.nan), np.full(len(residuals), np.nan)
    speed = problem.quantity("wheel_speed_front") * problem.config.wheel_radius_front if problem.logs else residuals
    pieces, sizes = {}, np.zeros(0)
    for i in range(len(problem.logs)):
        mine = [(rows.log == i) & rows.of(c) for c in (("accel_x",) if along else ("accel_y", "yaw_rate"))]
        if not all(problem.weight[m].any() for m in mine):
            continue
        z, w = (np.stack([x[m] for m in mine], axis=1) for x in (residuals, problem.weight))
        noise = np.array([1.0 / np.median(one[one > 0]) for one in w.T])
        if not len(sizes):  # the same for all logs
            sizes = noise[0] * np.tile(SIZES, len(TIMES)) if along else entry.size * np.array(FACTORS)
        time = rows.time[mine[0]]
        if along:
            models = [
                _longitudinal(time, w, noise, *st) for st in zip(sizes, np.repeat(TIMES, len(SIZES)), strict=True)
            ]
        else:
            stiffness = problem.stiffness(values, i)
            models = [
                _lateral(problem.config, stiffness, replace(entry, size=s), time, speed[mine[0]], w, noise)
                for s in sizes
            ]
        pieces[i] = z, models
    if not pieces:
        return Latent(entry.place, PLACES.get(entry.place, "m/s2"), value, sd)
    stacked = ((z, [np.stack(part, axis=-3) for part in zip(*models, strict=True)]) for z, models in pieces.values())
    best = int(np.argmax(sum(_forward(z, *model)[0] for z, model in stacked)))
    for i, (z, models) in pieces.items():
        x, p = smooth(z, *models[best])
        k = 0 if along else 2
        times = len(problem.logs[i].channels)  # a log's rows are its blocks, once for each of its channels
        value[rows.log == i] = np.tile(sizes[best] * x[:, k], times)
        sd[rows.log == i] = np.tile(sizes[best] * np.sqrt(np.maximum(p[:, k, k], 0.0)), times)
    return Latent(entry.place, PLACES.get(entry.place, "m/s2"), value, sd)


def _lateral(
    c: Config,
    stiffness: dict[str, float],
    entry: Entry,
    time: np.ndarray,
    speed: np.ndarray,
    w: np.ndarray,
    noise: np.ndarray,
) -> tuple[np.ndarray, ...]:
    """Transitions, their noise, readings and start of the model of where._filter(): states vel_y, yaw rate, disturbance over
    its size; and, which it does not need, the biases of both sensors over their noise, constant: residuals are without their
    mean over the log, and so the disturbance's own mean is only as certain as what else shows it."""
    car = SingleTrack.of(c, stiffness)
    across, turning, to_ay, to_r = enters(car, entry.place, entry.size)
    n, tau = len(time), entry.time_constant
    step = np.clip(np.diff(time, prepend=time[0] - BLOCK), 0.01, 0.2)
    a = np.zeros((n, 3, 3))
    car.fill(a, speed, across, turning)
    a[:, 2, 2] = -1.0 / tau
    # Van Loan: what drives the disturbance within a step moves the car within it, too; left out, a moment comes half a step
    # late and the band of it is half as wide as its error
    whole = np.zeros((n, 6, 6))
    whole[:, :3, :3], whole[:, 3:, 3:], whole[:, 2, 5] = -a, np.swapaxes(a, -1, -2), 2.0 / tau
    whole = expm(whole * step[:, None, None])
    f, q = np.tile(np.eye(5), (n, 1, 1)), np.zeros((n, 5, 5))
    f[:, :3, :3] = np.swapaxes(whole[:, 3:, 3:], -1, -2)
    q[:, :3, :3] = f[:, :3, :3] @ whole[:, :3, 3:]
    h = np.zeros((n, 2, 5))
    (h[:, 0, 0], h[:, 0, 1]), h[:, 0, 2] = car.side(speed), to_ay
    h[:, 1, 1], h[:, 1, 2] = 1.0, to_r
    h[:, [0, 1], [3, 4]] = noise
    p = np.diag([0.0, 0.0, 1.0, BIAS**2, BIAS**2])
    for _ in range(
        round(BURN_IN / BLOCK)
    ):  # a stretch has been simulated so long before it is compared: the car has answered
        p = f[0] @ p @ f[0].T + q[0]
    return f, q, w[:, :, None] * h, p


def _longitudinal(
    time: np.ndarray, w: np.ndarray, noise: np.ndarray, size: float, tau: float
) -> tuple[np.ndarray, ...]:
    """The same for a disturbance that accel_x reads, and its bias."""
    n = len(time)
    f, q, h = np.tile(np.eye(2), (n, 1, 1)), np.zeros((n, 2, 2)), np.zeros((n, 1, 2))
    f[:, 0, 0] = np.exp(-np.clip(np.diff(time, prepend=time[0] - BLOCK), 0.01, 0.2) / tau)
    q[:, 0, 0] = 1.0 - f[:, 0, 0] ** 2
    h[:, :, 0], h[:, :, 1] = w * size, w * noise
    return f, q, h, np.diag([1.0, BIAS**2])


def _forward(
    z: np.ndarray, f: np.ndarray, q: np.ndarray, h: np.ndarray, p: np.ndarray
) -> tuple[np.ndarray, list[tuple]]:
    """Kalman filter, of many models at once if they are stacked: log likelihood; and of each block state, covariance,
    innovation, the inverse of its covariance and gain. Noise of a reading is 1; what was not measured has a row of zeros in
    h, and so neither gain nor say in the likelihood."""
    x, loglik, kept = np.zeros((*p.shape[:-1], 1)), 0.0, []
    one = np.eye(z.shape[1])
    for k in range(len(z)):
        x, p = f[k] @ x, f[k] @ p @ np.swapaxes(f[k], -1, -2) + q[k]
        e = z[k][:, None] - h[k] @ x
        ph = p @ np.swapaxes(h[k], -1, -2)
        s = h[k] @ ph + one
        inverse = np.linalg.inv(s)
        gain = ph @ inverse
        loglik = loglik - 0.5 * ((np.swapaxes(e, -1, -2) @ inverse @ e)[..., 0, 0] + np.log(np.linalg.det(s)))
        x, p = x + gain @ e, p - gain @ np.swapaxes(ph, -1, -2)
        p = 0.5 * (p + np.swapaxes(p, -1, -2))
        kept.append((x, p, e, inverse, gain))
    return loglik, kept


def smooth(z: np.ndarray, f: np.ndarray, q: np.ndarray, h: np.ndarray, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean (blocks, states) and covariance of the states given all readings z (blocks, channels).

    Fixed-interval smoother in the form of Bryson and Frazier: what Rauch, Tung and Striebel's gives, without the inverse of a
    covariance that is nearly singular, for vel_y and yaw rate have no noise of their own."""
    _, kept = _forward(z, f, q, h, p)
    n, s = len(z), p.shape[-1]
    mean, covariance = np.zeros((n, s)), np.zeros((n, s, s))
    adjoint, information = np.zeros((s, 1)), np.zeros((s, s))
    for k in range(n - 1, -1, -1):
        x, p, e, inverse, gain = kept[k]
        mean[k] = (x + p @ adjoint)[:, 0]
        covariance[k] = p - p @ information @ p
        rest = np.eye(s) - gain @ h[k]
        adjoint = f[k].T @ (h[k].T @ inverse @ e + rest.T @ adjoint)
        information = f[k].T @ (h[k].T @ inverse @ h[k] + rest.T @ information @ rest) @ f[k]
    return mean, covariance


# ---- what it follows


def signals(problem: Problem, values: Mapping[str, float]) -> dict[str, np.ndarray]:
    """What a disturbance may follow, with sign, one value per entry of the residual vector, in UNITS: from inputs and the
    simulation only, never from what was measured, whose noise is in the disturbance, too."""
    found = problem.channels(values, ("vel_x", "accel_x", "accel_y", "yaw_rate"))
    speed = found.pop("vel_x")
    front = problem.quantity("wheel_speed_front") * problem.config.wheel_radius_front
    rate = [np.tile(blocks(g, np.gradient(g.inputs["steer_angle"], g.time))[0], len(g.channels)) for g in problem.logs]
    return {
        "speed": speed,
        "steer": problem.quantity("steer_angle"),
        "steer_rate": np.concatenate(rate),
        **found,
        "slip_front": front / np.maximum(speed, 1.0) - 1.0,
        "time": problem.rows.time.astype(float),
    }


def best_explaining(problem: Problem, latent: Latent, signals: Mapping[str, np.ndarray]) -> list[Explained]:
    """Quantities that the disturbance follows, best first, at most MOST; none that chance explains.

    The function of a quantity is its mean in BINS quantile bins, not a polynomial: that stays where it was when a log that was
    left out goes further than the others, and shows a dead band or a limit as it is. Bins know only the order of a quantity, so
    that x and x|x| explain the same: the one that is named is that over which the disturbance is straighter.

    Chance: the best of all quantities for the disturbance shifted in a circle, the largest of SHIFTS. The mean of a log is the
    sensors' bias, and counts neither way."""
    _, moments = np.unique(problem.rows.block, return_index=True)  # one row of each block
    columns = np.stack([latent.value, *signals.values()])
    moments = moments[np.isfinite(columns[:, moments]).all(axis=0)]
    y, log = latent.value[moments], problem.rows.log[moments]
    n = len(y)
    if n < 10 * BINS or not np.ptp(y) > 0:
        return []
    _, log = np.unique(log, return_inverse=True)
    fold = log if log[-1] >= 2 else np.arange(n) * FOLDS // n
    shifts = np.random.default_rng(1).integers(n // 10, n - n // 10, SHIFTS)
    ys = np.stack([y, *(np.roll(y, s) for s in shifts)], axis=1)
    ys -= (_sums(log, ys) / np.bincount(log)[:, None])[log]
    tried = _candidates({name: x[moments] for name, x in signals.items()}, ys[:, 0])
    shares = np.array([_share(x, ys, log, fold) for x, _ in tried.values()]).reshape(len(tried), -1)
    chance = float(max(shares[:, 1:].max(initial=0.0), 0.0))
    found = []
    for k in np.argsort(-shares[:, 0], kind="stable")[:MOST]:
        if shares[k, 0] <= chance:
            break
        name = list(tried)[k]
        x, unit = tried[name]
        quantity = np.full(len(latent.value), np.nan)
        quantity[moments] = x
        quantity = quantity[_first(problem)]
        found.append(Explained(name, float(shares[k, 0]), _shape(x, y), unit, quantity, chance))
    return found


def _first(problem: Problem) -> np.ndarray:
    """Of every row the first row of its block."""
    _, first, index = np.unique(problem.rows.block, return_index=True, return_inverse=True)
    return first[index]


def _candidates(signals: dict[str, np.ndarray], y: np.ndarray) -> dict[str, tuple[np.ndarray, str]]:
    """Signals and products, with units; no magnitudes. What has one sign only is also multiplied as its difference from its
    mean: a gain that goes up here and down there is no function of speed times steering, but is one of that."""
    moving = {name: x for name, x in signals.items() if np.ptp(x) > 1e-9 * (1.0 + np.abs(x).max())}
    signed = [name for name, x in moving.items() if x.min() < 0 < x.max()]

    def unit(*names: str) -> str:
        return " ".join(u for name in names for u in [UNITS.get(name, "")] if u not in ("", "1")) or "1"

    def straight(x: np.ndarray) -> float:
        return float(np.corrcoef(x, y)[0, 1] ** 2)

    found = {}
    for name, x in moving.items():
        if name in signed and straight(x * np.abs(x)) > straight(x):
            found[f"{name}*|{name}|"] = x * np.abs(x), unit(name, name)
        else:
            found[name] = x, unit(name)
    for a, b in combinations(moving, 2):
        found[f"{a}*{b}"] = moving[a] * moving[b], unit(a, b)
    for a, b in permutations(moving, 2):
        if b in signed and a not in signed:
            found[f"({a} - {moving[a].mean():.3g})*{b}"] = (moving[a] - moving[a].mean()) * moving[b], unit(a, b)
        elif a in signed and b in signed:
            found[f"{a}*|{b}|"] = moving[a] * np.abs(moving[b]), unit(a, b)
    return found


def _bins(x: np.ndarray) -> np.ndarray:
    """Which quantile bin each value is in; fewer than BINS where many are the same."""
    edges = np.unique(np.quantile(x, np.arange(1, BINS) / BINS))
    return np.searchsorted(edges, x, side="right")


def _sums(group: np.ndarray, ys: np.ndarray, groups: int = 0) -> np.ndarray:
    """Sums of the rows of each group, (groups, columns)."""
    shape = (max(groups, int(group.max()) + 1), len(group))
    return csr_matrix((np.ones(len(group)), (group, np.arange(len(group)))), shape) @ ys


def _share(x: np.ndarray, ys: np.ndarray, log: np.ndarray, fold: np.ndarray) -> np.ndarray:
    """Share of the variance within logs that the means over the bins of x, of the other folds, explain; per column of ys."""
    bins = _bins(x)
    folds, cells = int(fold.max()) + 1, BINS * (int(fold.max()) + 1)
    cell = fold * BINS + bins
    count = np.bincount(cell, minlength=cells).reshape(folds, BINS, 1)
    total = _sums(cell, ys, cells).reshape(folds, BINS, -1)
    others = count.sum(axis=0) - count
    predicted = np.where(others > 0, (total.sum(axis=0) - total) / np.maximum(others, 1), 0.0)
    rest = ys - predicted.reshape(cells, -1)[cell]
    energy = (rest**2).sum(axis=0) - (_sums(log, rest) ** 2 / np.bincount(log)[:, None]).sum(axis=0)
    return 1.0 - energy / np.maximum((ys**2).sum(axis=0), 1e-300)


def _shape(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    bins = _bins(x)
    parts = [(x[bins == b], y[bins == b]) for b in np.unique(bins)]
    return np.array([[np.median(u), v.mean(), *np.quantile(v, [0.25, 0.75])] for u, v in parts])
