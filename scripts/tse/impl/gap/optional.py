"""What the optional channels read of what the car does: speed over ground and torques of the wheels.

Nobody calibrates them as an IMU is: a GNSS or optical speed comes late and may be some percent out; a drive torque comes from
the map of an engine and a brake torque from a pressure and a coefficient of friction. Up to what is plausible (SCALE, LATENCY)
such errors are the sensor's, found in closed form for each log as biases are; beyond it they are the car's. And axles whose
wheels differ in radius by a thousandth, which nobody knows, brace against each other through the road: a constant torque in
front, its opposite in the rear. The common part of a constant is the car's: it is how rolling resistance shows.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from tse.impl.rows import OPTIONAL, TORQUES

# up to here an error of scale is the sensor's, beyond it the car's: a drive torque comes from the map of an engine, a
# brake torque from a pressure and a coefficient of friction
SCALE = {"vehicle_speed": 0.05, "wheel_torque_front": 0.15, "wheel_torque_rear": 0.15}
LATENCY = 0.3  # s: the same of lateness, as of a GNSS receiver
BRACED = 1000.0  # N m: sd that is known beforehand of the torque that axles brace with
ROUNDS = 4  # of the search for the latency: always as many, so that what is read is smooth in the parameters
GAP = 0.06  # s: blocks further apart are of two pieces
# 1, s: what a user should know
WORTH = {"vehicle_speed": 0.01, "wheel_torque_front": 0.05, "wheel_torque_rear": 0.05, "latency": 0.03}


@dataclass(frozen=True)
class Reading:
    """How a channel of one log reads: found value and its sd."""

    channel: str
    key: str  # scale, scale driving, scale braking, latency, braced
    value: float
    sd: float


def words(readings: Sequence[Sequence[Reading]]) -> list[str]:
    """What a user should know of them, all logs together; logs without a channel weigh nothing."""
    found: dict[tuple[str, str], tuple[float, float]] = {}
    for r in (r for log in readings for r in log if r.key != "braced"):
        weight, total = found.get((r.channel, r.key), (0.0, 0.0))
        found[r.channel, r.key] = (weight + r.sd**-2, total + r.value * r.sd**-2)
    lines = []
    for (channel, key), (weight, total) in found.items():
        value, sd = total / weight, weight**-0.5
        late = key == "latency"
        if sd > 0.1 * (LATENCY if late else SCALE[channel]) or abs(value) < max(
            WORTH["latency" if late else channel], 3 * sd
        ):
            continue
        most = f"{LATENCY:g} s" if late else f"{100 * SCALE[channel]:.0f} %"
        side = "late" if value > 0 else "early"
        how = f"{abs(value):.2f} s {side}" if late else f"{100 * value:+.1f} %{key.removeprefix('scale')}"
        lines.append(f"{channel} reads {how}: taken as the sensor's own, as up to {most} are")
    return lines


class _Shifted:
    """A prediction as a function of time, smooth between its blocks (Catmull-Rom), a piece for each stretch."""

    def __init__(self, time: np.ndarray, x: np.ndarray):
        ends = np.flatnonzero(np.diff(time, append=np.inf) > GAP) + 1
        self.step = float(np.median(np.diff(time))) if len(time) > 1 else 1.0
        self.margin = int(LATENCY / self.step) + 4
        self.pieces = [np.pad(piece, self.margin, mode="edge") for piece in np.split(x, ends[:-1])]

    def at(self, latency: float) -> tuple[np.ndarray, np.ndarray]:
        """The prediction of so much earlier, and its slope over the latency."""
        back = int(np.floor(latency / self.step))
        u = 1.0 - (latency / self.step - back)  # between the block before the asked time, 0, and the one after, 1
        weights = 0.5 * np.array(
            [-u + 2 * u**2 - u**3, 2 - 5 * u**2 + 3 * u**3, u + 4 * u**2 - 3 * u**3, -(u**2) + u**3]
        )
        slopes = (
            -0.5
            * np.array([-1 + 4 * u - 3 * u**2, -10 * u + 9 * u**2, 1 + 8 * u - 9 * u**2, -2 * u + 3 * u**2])
            / self.step
        )
        y, slope = [], []
        for x in self.pieces:
            n, first = len(x) - 2 * self.margin, self.margin - back - 2
            around = np.stack([x[first + k : first + k + n] for k in range(4)])
            y.append(weights @ around)
            slope.append(slopes @ around)
        return np.concatenate(y), np.concatenate(slope)


def read(
    time: np.ndarray,
    predicted: Mapping[str, np.ndarray],
    measured: Mapping[str, np.ndarray],
    weight: Mapping[str, np.ndarray],
) -> tuple[dict[str, np.ndarray], list[Reading]]:
    """What the optional channels of one log would read, blocks of `time`, and how that was found."""
    names = [c for c in OPTIONAL if c in predicted]
    found: dict[str, np.ndarray] = {}
    readings: list[Reading] = []
    for together in ([c for c in names if c in TORQUES], [c for c in names if c not in TORQUES]):
        if together:
            y, how = _read(time, {c: predicted[c] for c in together}, measured, weight)
            found |= y
            readings += how
    return found, readings


def _read(
    time: np.ndarray,
    predicted: dict[str, np.ndarray],
    measured: Mapping[str, np.ndarray],
    weight: Mapping[str, np.ndarray],
) -> tuple[dict[str, np.ndarray], list[Reading]]:
    """Weighted least squares over scales, latencies and bracing, with bounds; Gauss-Newton because of the latencies."""
    shifted = {c: _Shifted(time, x) for c, x in predicted.items()}
    w = np.concatenate([weight[c] for c in predicted])
    y = np.concatenate([measured[c] for c in predicted])
    n = len(time)
    keys: list[tuple[str, str]] = []
    limits, known = [], []
    for c in predicted:
        scales = ("scale driving", "scale braking") if c in TORQUES else ("scale",)
        keys += [(c, s) for s in scales] + [(c, "latency")]
        limits += [SCALE[c]] * len(scales) + [LATENCY]
        known += [0.5 * SCALE[c]] * len(scales) + [0.5 * LATENCY]
    if any(c in TORQUES for c in predicted):
        keys.append((next(iter(predicted)), "braced"))
        limits.append(np.inf)
        known.append(BRACED)
    limit, prior = np.array(limits), np.diag(1.0 / np.array(known) ** 2)
    latency = [k for k, (_, key) in enumerate(keys) if key == "latency"]
    theta = np.zeros(len(keys))
    for _ in range(ROUNDS):
        columns, base = np.zeros((len(y), len(keys))), np.zeros(len(y))
        for i, c in enumerate(predicted):
            rows = slice(i * n, (i + 1) * n)
            late = next(k for k in latency if keys[k][0] == c)
            base[rows], columns[rows, late] = shifted[c].at(float(theta[late]))
            for k, (channel, key) in enumerate(keys):
                if channel == c and key.startswith("scale"):
                    columns[rows, k] = _part(base[rows], key)
                elif key == "braced":
                    columns[rows, k] = 1.0 if i == 0 else -1.0
        before = theta[latency].copy()
        whitened = columns * w[:, None]
        target = w * (y - base) + whitened[:, latency] @ before  # linear in the latency about the one there is
        theta = _bounded(whitened.T @ whitened + prior, whitened.T @ target, limit)
    step = theta.copy()
    step[latency] -= before
    read_as = base + columns @ step
    sd = np.sqrt(np.maximum(np.diag(np.linalg.inv(whitened.T @ whitened + prior)), 0.0))
    readings = [Reading(c, key, float(t), float(s)) for (c, key), t, s in zip(keys, theta, sd, strict=True)]
    return {c: read_as[i * n : (i + 1) * n] for i, c in enumerate(predicted)}, readings


def _part(x: np.ndarray, key: str) -> np.ndarray:
    return np.maximum(x, 0.0) if key == "scale driving" else np.minimum(x, 0.0) if key == "scale braking" else x


def _bounded(gram: np.ndarray, right: np.ndarray, limit: np.ndarray) -> np.ndarray:
    """Least squares within +-limit: what runs out of its bounds stays on them, the others are solved again."""
    theta, free = np.zeros(len(right)), np.ones(len(right), bool)
    for _ in range(len(right) + 1):
        rest = right[free] - gram[np.ix_(free, ~free)] @ theta[~free]
        theta[free] = np.linalg.solve(gram[np.ix_(free, free)], rest)
        out = free & (np.abs(theta) > limit)
        if not out.any():
            break
        theta[out] = np.sign(theta[out]) * limit[out]
        free &= ~out
    return theta
