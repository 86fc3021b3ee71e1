"""Where simulation and measurement disagree: under which conditions, and at which entry point of the car.

Conditions: energies of the whitened residual in windows of 1 s against speed, accelerations, steering rate, slip and time
(Spearman), and between logs (Kruskal-Wallis), with the Benjamini-Hochberg bound on false discoveries.
Entry point: a latent force, moment, slope or sensor error that drifts (Ornstein-Uhlenbeck) is put in turn at each place; the
one whose Kalman filter explains accel_y and yaw_rate best is where something enters that the model does not have.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import false_discovery_control, kruskal, spearmanr

from tselab.gap import constants
from tselab.gap.data import BLOCK, CHANNELS
from tselab.gap.fit import Fit
from tselab.gap.problem import Problem
from tselab.gap.singletrack import SingleTrack

WINDOW, FALSE_DISCOVERIES, LEAST_CORRELATION, FEWEST_WINDOWS, MOST_FOLLOWED, TIMES, SIZES = constants.of(
    __name__, "WINDOW", "FALSE_DISCOVERIES", "LEAST_CORRELATION", "FEWEST_WINDOWS", "MOST_FOLLOWED", "TIMES", "SIZES"
)  # fmt: skip


@dataclass(frozen=True)
class Condition:
    """The residual of a channel grows with (or differs between) something."""

    channel: str
    condition: str
    strength: float  # rank correlation; between logs: share of the variance of ranks
    p: float  # after the false-discovery bound
    ratio: float  # energy in the upper third of the condition over that in the lower third; between logs: largest over smallest
    words: str


@dataclass(frozen=True)
class Entry:
    """How well a disturbance at this place explains the residuals."""

    place: str
    nats: float
    share: float  # of the gap in accel_y and yaw_rate that it takes up
    size: float  # sd of the disturbance
    unit: str
    time_constant: float  # s
    follows: float  # share of the disturbance's variance that the car's own lateral acceleration explains


def windows(
    problem: Problem, residuals: np.ndarray, features: dict[str, np.ndarray]
) -> dict[str, dict[str, np.ndarray]]:
    """Per channel: energy (mean square) and the features' means in windows of 1 s; features have one value per residual."""
    found = {}
    rows = problem.rows
    for c in np.unique(rows.channel):
        mine = (rows.channel == c) & (problem.weight > 0)
        key = rows.log[mine] * 10_000_000 + (rows.time[mine] // WINDOW).astype(np.int64)
        _, index = np.unique(key, return_inverse=True)
        count = np.bincount(index).astype(float)
        enough = count >= 0.5 * count.max()
        table = {
            "energy": np.bincount(index, residuals[mine] ** 2) / count,
            "log": np.bincount(index, rows.log[mine]) / count,
        }
        for name, x in features.items():
            table[name] = np.bincount(index, np.nan_to_num(x[mine])) / count
        found[CHANNELS[c]] = {name: x[enough] for name, x in table.items()}
    return found


def features(problem: Problem, values: dict[str, float]) -> dict[str, np.ndarray]:
    """What conditions are made of, from inputs and the simulation only: never from what was measured, whose noise is in the
    residual, too."""
    predicted = problem.channels(values, ("accel_x", "accel_y", "vel_x"))
    steer = problem.quantity("steer_angle")
    front = problem.quantity("wheel_speed_front") * problem.config.wheel_radius_front
    rate = np.gradient(steer) / BLOCK
    return {
        "speed": predicted["vel_x"],
        "|accel_y|": np.abs(predicted["accel_y"]),
        "|accel_x|": np.abs(predicted["accel_x"]),
        "|steering angle|": np.abs(steer),
        "|steering rate|": np.abs(rate),
        "|slip|": np.abs(front / np.maximum(predicted["vel_x"], 1.0) - 1.0),
        "time": problem.rows.time.astype(float),
    }


def conditions(problem: Problem, residuals: np.ndarray, values: dict[str, float]) -> list[Condition]:
    """Where the residual is large, strongest first; none that chance explains."""
    tests = []
    for channel, table in windows(problem, residuals, features(problem, values)).items():
        energy = table.pop("energy")
        log = np.round(table.pop("log")).astype(int)
        if len(energy) < FEWEST_WINDOWS:
            continue
        for name, x in table.items():
            if np.ptp(x) <= 1e-9 * (1 + np.abs(x).max()):
                continue
            rho, p = spearmanr(x, energy)
            low, high = np.quantile(x, [1 / 3, 2 / 3])
            ratio = float(energy[x >= high].mean() / max(energy[x <= low].mean(), 1e-12))
            words = f"{channel}: {'larger' if rho > 0 else 'smaller'} with {name}, {ratio:.1f} times between lower and upper third"
            tests.append((channel, f"{'high' if rho > 0 else 'low'} {name}", float(rho), float(p), ratio, words))
        groups = [energy[log == i] for i in np.unique(log) if (log == i).sum() >= 5]
        if len(groups) > 1:
            h, p = kruskal(*groups)
            means = [g.mean() for g in groups]
            ids = [i for i in np.unique(log) if (log == i).sum() >= 5]
            worst = problem.logs[ids[int(np.argmax(means))]].name
            ratio = max(means) / max(min(means), 1e-12)
            words = f"{channel}: largest in {worst}, {ratio:.1f} times the smallest"
            tests.append((channel, f"log {worst}", float(h / (len(energy) - 1)), float(p), ratio, words))
    if not tests:
        return []
    adjusted = false_discovery_control([max(t[3], 1e-300) for t in tests], method="bh")
    kept = [
        Condition(c, name, rho, float(p), ratio, words)
        for (c, name, rho, _, ratio, words), p in zip(tests, adjusted, strict=True)
        if p < FALSE_DISCOVERIES and abs(rho) >= LEAST_CORRELATION
    ]
    return sorted(kept, key=lambda k: -abs(k.strength))


ROAD = "road (bank)"
# place: force at a distance before the centre of gravity (front, rear, side), moment, gravity, or a sensor's error
PLACES = {
    "front axle": "N",
    "rear axle": "N",
    "side force": "N",
    "yaw moment": "N m",
    ROAD: "m/s2",
    "sensor accel_y": "m/s2",
    "sensor yaw_rate": "rad/s",
}


def enters(car: SingleTrack, place: str, size: float = 1.0) -> tuple[float, float, float, float]:
    """What a disturbance of this size at a place does to vel_y [m/s2] and yaw rate [rad/s2], and at once to the readings of accel_y
    and yaw_rate: an accelerometer feels forces and not gravity."""
    lever = {"front axle": car.lf, "rear axle": -car.lr, "side force": 0.0}
    across, turning = car.pushed(
        size if place in lever else 0.0, lever.get(place, 0.0), size if place == "yaw moment" else 0.0
    )
    felt = across + (size if place == "sensor accel_y" else 0.0)
    return across + (size if place == ROAD else 0.0), turning, felt, size if place == "sensor yaw_rate" else 0.0


def entries(problem: Problem, baseline: Fit) -> list[Entry]:
    """Every place with the evidence for a disturbance there, best first; stiffness is refitted beside it.

    A fit without the disturbance has bent the stiffness towards it, and so spread over both channels what may have come in at
    one. A Kalman filter is linear in what it filters, so the slopes over the stiffness go through it beside the residuals, and
    the best stiffness is a regression of one on the others: of innovations for the evidence, of what is left for the share."""
    places, batch = list(PLACES), len(TIMES) * len(SIZES)
    n = 1 + baseline.jacobian.shape[1]
    products, left = np.zeros((len(places), batch, n, n)), np.zeros((len(places), batch, n, n))
    nothing, spread = np.zeros((n, n)), np.zeros((len(places), batch))
    size_of = np.zeros((len(places), batch))
    sought, drive = [], []
    turning = problem.channels(baseline.values, ("accel_y",))["accel_y"]
    for i in range(len(problem.logs)):
        piece = _lateral(problem, baseline, i)
        if piece is None:
            continue
        p, f, s, size_of, p0, d = _filter(problem, baseline.values, piece, places)
        sought.append(d)
        drive.append(turning[(problem.rows.log == i) & problem.rows.of("accel_y")])
        products += p
        left += f
        spread += s
        nothing += p0
    if nothing[0, 0] <= 0:
        return []
    total, _ = _regress(nothing)
    disturbance, ay = np.concatenate(sought), np.concatenate(drive)
    found = []
    for k, place in enumerate(places):
        squares, slopes = _regress(products[k])
        loglik = -0.5 * (squares + spread[k])
        b = int(np.argmax(loglik))
        rest = float(slopes[b] @ left[k, b] @ slopes[b])
        found.append(
            Entry(
                place,
                float(loglik[b] + 0.5 * total),
                float(np.clip(1.0 - rest / nothing[0, 0], 0.0, 1.0)),
                float(size_of[k, b]),
                PLACES[place],
                TIMES[b // len(SIZES)],
                _explained(disturbance[:, k, b] @ slopes[b], ay),
            )
        )
    # a road does not know of the steering wheel: what follows the car's own turning came in elsewhere
    return sorted(found, key=lambda e: (e.place == ROAD and e.follows > MOST_FOLLOWED, -e.nats))


def _explained(y: np.ndarray, x: np.ndarray) -> float:
    """Share of the variance of y that x and its past explain."""
    columns = np.column_stack([np.roll(x, lag) for lag in (0, 2, 5)] + [np.ones(len(x))])
    rest = y - columns @ np.linalg.lstsq(columns, y, rcond=None)[0]
    return float(1.0 - rest.var() / y.var()) if y.var() > 0 else 0.0


def _regress(products: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """From sums of products of (residual, slopes ...): the smallest sum of squares over the parameters, and (1, parameters)."""
    a, b = products[..., 1:, 1:], products[..., 1:, :1]
    ridge = 1e-9 * np.trace(a, axis1=-2, axis2=-1)[..., None, None] * np.eye(a.shape[-1]) + 1e-300 * np.eye(a.shape[-1])
    x = -np.linalg.solve(a + ridge, b)
    squares = products[..., 0, 0] + (np.swapaxes(b, -1, -2) @ x)[..., 0, 0]
    return squares, np.concatenate([np.ones_like(x[..., :1, 0]), x[..., 0]], axis=-1)


def _lateral(problem: Problem, baseline: Fit, i: int) -> tuple | None:
    rows = problem.rows
    mine = {c: (rows.log == i) & rows.of(c) for c in ("accel_y", "yaw_rate")}
    if not all(m.any() for m in mine.values()):
        return None
    ay, r = mine["accel_y"], mine["yaw_rate"]
    signals = np.column_stack([baseline.residuals, baseline.jacobian])
    speed = problem.quantity("wheel_speed_front")[r] * problem.config.wheel_radius_front
    return np.stack([signals[ay], signals[r]], axis=1), problem.weight[ay], problem.weight[r], speed, rows.time[r]


def _filter(problem: Problem, values: dict[str, float], piece: tuple, places: list[str]) -> tuple:
    """Kalman filters of (vel_y, yaw rate, disturbance), all places, time constants and sizes at once.

    Returned, sums over the log: products of whitened innovations, products of what is left, log det of the innovations, the
    sizes (sd), products of the signals themselves; and the disturbance in each block, per signal."""
    signals, w_ay, w_r, speed, time = piece
    car = SingleTrack.of(problem.config, values)
    across, turning, to_ay, to_r = (np.array(x)[:, None] for x in zip(*(enters(car, p) for p in places), strict=True))
    sd_ay, sd_r = 1.0 / np.median(w_ay[w_ay > 0]), 1.0 / np.median(w_r[w_r > 0])
    size_of = {"N": car.mass * sd_ay, "N m": car.inertia * sd_r / 0.3, "m/s2": sd_ay, "rad/s": sd_r}
    unit = np.array([size_of[PLACES[p]] for p in places])
    tau = np.repeat(TIMES, len(SIZES))[None, :]
    size = unit[:, None] * np.tile(SIZES, len(TIMES))[None, :]
    shape = (len(places), tau.shape[1])
    n = signals.shape[2]
    x = np.zeros((*shape, 3, n))
    p = np.zeros((*shape, 3, 3))
    p[..., 2, 2] = size**2
    products, left, spread, plain = (
        np.zeros((*shape, n, n)),
        np.zeros((*shape, n, n)),
        np.zeros(shape),
        np.zeros((n, n)),
    )
    disturbance = np.zeros((len(signals), *shape, n))
    a = np.zeros((*shape, 3, 3))
    a[..., 2, 2] = -1.0 / tau
    h = np.zeros((*shape, 2, 3))
    for k in range(len(signals)):
        step = float(np.clip(time[k] - time[k - 1], 0.01, 0.2)) if k else BLOCK
        yv, yr = car.side(speed[k])
        car.fill(a, speed[k], across, turning)
        ah = a * step
        f = np.eye(3) + ah + ah @ ah / 2 + ah @ ah @ ah / 6 + ah @ ah @ ah @ ah / 24
        f[..., 2, 2] = np.exp(-step / tau)
        x = f @ x
        p = f @ p @ np.swapaxes(f, -1, -2)
        p[..., 2, 2] += size**2 * (1.0 - np.exp(-2.0 * step / tau))
        h[..., 0, 0], h[..., 0, 1] = yv * w_ay[k], yr * w_ay[k]
        h[..., 0, 2] = w_ay[k] * to_ay
        h[..., 1, 1] = w_r[k]
        h[..., 1, 2] = w_r[k] * to_r
        z = signals[k] - h @ x
        ph = p @ np.swapaxes(h, -1, -2)
        s = h @ ph + np.eye(2)
        s = 0.5 * (s + np.swapaxes(s, -1, -2))
        det = np.maximum(s[..., 0, 0] * s[..., 1, 1] - s[..., 0, 1] ** 2, 1.0)  # of I + h p h', whatever rounding says
        inv = np.empty_like(s)
        inv[..., 0, 0], inv[..., 1, 1] = s[..., 1, 1] / det, s[..., 0, 0] / det
        inv[..., 0, 1] = inv[..., 1, 0] = -s[..., 0, 1] / det
        products += np.swapaxes(z, -1, -2) @ inv @ z
        spread += np.log(det)
        gain = ph @ inv
        x = x + gain @ z
        p = p - gain @ np.swapaxes(ph, -1, -2)
        p = 0.5 * (p + np.swapaxes(p, -1, -2))
        rest = signals[k] - h @ x
        left += np.swapaxes(rest, -1, -2) @ rest
        plain += signals[k].T @ signals[k]
        disturbance[k] = x[..., 2, :]
    return products, left, spread, size, plain, disturbance
