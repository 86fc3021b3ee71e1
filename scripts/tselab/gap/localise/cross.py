"""Cross plots as vehicle dynamics has them: quasi-steady handling, and the response to the steering at each frequency.

Everything from blocks of 40 ms, measured and simulated alike, so that what averaging does cancels."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.signal import csd, welch

from tselab.core import Config
from tselab.gap import constants
from tselab.gap.data import BLOCK, Prepared
from tselab.gap.problem import Problem

(
    QUIET, STEER_RATE, ACCEL_RATE, LEAST_ACCEL, SPEED_BAND, ACCEL_BIN, FEWEST, SEGMENT, HIGHEST, COHERENT, EXCITED,
) = constants.of(
    __name__, "QUIET", "STEER_RATE", "ACCEL_RATE", "LEAST_ACCEL", "SPEED_BAND", "ACCEL_BIN", "FEWEST", "SEGMENT", "HIGHEST",
    "COHERENT", "EXCITED"
)  # fmt: skip
SOURCES = ("measured", "before", "after")


@dataclass(frozen=True)
class Curve:
    """One source in one speed band."""

    source: str
    speed: float  # m/s, middle of the band
    accel_y: np.ndarray
    value: np.ndarray


@dataclass(frozen=True)
class Response:
    """Gain and phase over the frequency, of one channel of one log."""

    log: str
    speed: float
    channel: str
    frequency: np.ndarray
    gain: dict[str, np.ndarray]
    phase: dict[str, np.ndarray]  # degrees


class Blocks:
    """Signals of one log in time order: steering, speed, and each channel by source."""

    def __init__(self, problem: Problem, i: int, predicted: dict[str, np.ndarray]):
        rows = problem.rows
        first = (rows.log == i) & rows.of("yaw_rate")
        self.log: Prepared = problem.logs[i]
        self.time = rows.time[first].astype(float)
        self.steer = problem.quantity("steer_angle")[first]
        config: Config = problem.config
        front = problem.quantity("wheel_speed_front")[first] * config.wheel_radius_front
        rear = problem.quantity("wheel_speed_rear")[first] * config.wheel_radius_rear
        self.speed = 0.5 * (front + rear)
        self.signals = {
            c: {s: predicted[s][(rows.log == i) & rows.of(c)] for s in SOURCES} for c in ("accel_y", "yaw_rate")
        }

    def pieces(self) -> list[slice]:
        """Without a hole in time."""
        cut = np.flatnonzero(np.diff(self.time) > 1.5 * BLOCK) + 1
        edges = [0, *cut, len(self.time)]
        return [slice(a, b) for a, b in pairwise(edges)]


def handling(blocks: list[Blocks], wheelbase: float) -> tuple[list[Curve], list[Curve]]:
    """Yaw-rate gain, and steering angle less what a slow car would need, over lateral acceleration; medians in bins."""
    found: dict[str, list[np.ndarray]] = {s: [] for s in SOURCES}
    for b in blocks:
        for piece in b.pieces():
            n = max(3, round(QUIET / BLOCK))
            if piece.stop - piece.start < 3 * n:
                continue
            steer, speed = b.steer[piece], b.speed[piece]
            calm = np.abs(np.gradient(uniform_filter1d(steer, 3)) / BLOCK) < STEER_RATE
            calm &= np.abs(np.gradient(uniform_filter1d(b.signals["accel_y"]["after"][piece], 5)) / BLOCK) < ACCEL_RATE
            steady = uniform_filter1d(calm.astype(float), n) > 1 - 0.5 / n
            for s in SOURCES:
                ay, r = b.signals["accel_y"][s][piece], b.signals["yaw_rate"][s][piece]
                good = steady & np.isfinite(ay) & np.isfinite(r)
                found[s].append(np.stack([speed[good], ay[good], r[good], steer[good]]))
    gains, angles = [], []
    for s in SOURCES:
        speed, ay, r, steer = np.concatenate(found[s], axis=1) if found[s] else np.zeros((4, 0))
        band = np.floor(speed / SPEED_BAND)
        for k in np.unique(band):
            mine = band == k
            sign = np.sign(r)
            turning = mine & (np.abs(ay) > LEAST_ACCEL) & (np.abs(steer) > 1e-3)
            middle = (k + 0.5) * SPEED_BAND
            x, y = _bins(np.abs(ay[turning]), r[turning] / steer[turning])
            if len(x) > 1:
                gains.append(Curve(s, middle, x, y))
            lean = mine & (np.abs(ay) > LEAST_ACCEL)
            understeer = sign * (steer - wheelbase * r / np.maximum(speed, 1.0))
            x, y = _bins(np.abs(ay[lean]), understeer[lean])
            if len(x) > 1:
                angles.append(Curve(s, middle, x, y))
    return _where_measured(gains), _where_measured(angles)


def _where_measured(curves: list[Curve]) -> list[Curve]:
    bands = {c.speed for c in curves if c.source == "measured"}
    return [c for c in curves if c.speed in bands]


def _bins(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    index = np.floor(x / ACCEL_BIN)
    keep = [k for k in np.unique(index) if (index == k).sum() >= FEWEST]
    return (
        np.array([float(np.median(x[index == k])) for k in keep]),
        np.array([float(np.median(y[index == k])) for k in keep]),
    )


def responses(blocks: list[Blocks]) -> list[Response]:
    """Of the log whose steering excites the widest range of frequencies; [] if none excites any."""
    best: tuple[int, list[Response]] = (0, [])
    for b in blocks:
        piece = max(b.pieces(), key=lambda p: p.stop - p.start)
        if piece.stop - piece.start < 2 * SEGMENT:
            continue
        steer = _filled(b.steer[piece])
        own = {c: {s: _filled(x[piece]) for s, x in sources.items()} for c, sources in b.signals.items()}
        options = {"fs": 1 / BLOCK, "nperseg": SEGMENT, "detrend": "linear"}
        frequency, power = welch(steer, **options)
        cross = {c: {s: csd(steer, x, **options)[1] for s, x in sources.items()} for c, sources in own.items()}
        r = welch(own["yaw_rate"]["measured"], **options)[1]
        coherence = np.abs(cross["yaw_rate"]["measured"]) ** 2 / np.maximum(power * r, 1e-300)
        keep = (coherence > COHERENT) & (power > EXCITED * power.max()) & (frequency > 0.1) & (frequency <= HIGHEST)
        if keep.sum() <= best[0] or keep.sum() < 4:
            continue
        found = []
        for c, of in cross.items():
            h = {s: x[keep] / power[keep] for s, x in of.items()}
            found.append(
                Response(
                    b.log.name, float(np.median(b.speed[piece])), c, frequency[keep], {s: np.abs(x) for s, x in h.items()},
                    {s: np.degrees(np.unwrap(np.angle(x))) for s, x in h.items()},
                )
            )  # fmt: skip
        best = int(keep.sum()), found
    return best[1]


def _filled(x: np.ndarray) -> np.ndarray:
    good = np.isfinite(x)
    return np.interp(np.arange(len(x)), np.flatnonzero(good), x[good]) if good.any() else np.zeros(len(x))
