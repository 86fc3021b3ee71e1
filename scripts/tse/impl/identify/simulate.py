"""The model on one log: smoothed inputs in, what the sensors should read out; every stretch from a start of its own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from scipy.interpolate import CubicSpline

from tse.impl.core import Config, Replay

if TYPE_CHECKING:
    from tse.impl.identify.data import Prepared


def simulate(
    config: Config,
    log: Prepared,
    channels: Sequence[str],
    stiffness: dict[str, float],
    profiles: dict[str, np.ndarray],
    later: Mapping[str, float] | None = None,
) -> dict[str, np.ndarray]:
    """Predicted channels, one value per row, as late as the log has them; NaN between stretches. Biases are not in it.

    `later`: s, by channel: how much later it is than the vehicle file says."""
    later = later or {}
    out = {c: np.full(len(log.time), np.nan) for c in channels}
    for s in log.stretches:
        rows = slice(s.first, s.last)
        dt = np.diff(log.time[rows], prepend=log.time[s.first] - 0.01)
        inputs = {n: x[rows] for n, x in (log.inputs | profiles).items()}
        inputs |= {n: log.later(n, by, rows) for n, by in later.items() if by and n in log.inputs}
        replay = Replay(tuple(channels), dt=dt, **inputs)
        gyro = log.measured["yaw_rate"][s.first] if "yaw_rate" in log.measured else np.nan
        found = replay.run(
            config, yaw_rate=float(gyro) if np.isfinite(gyro) else 0.0, time=float(log.time[s.first] - log.time[0]), **stiffness
        )
        for c, x in found.items():
            late, t = log.late.get(c, 0.0) + later.get(c, 0.0), log.time[rows]
            out[c][rows] = CubicSpline(t, x)(np.clip(t - late, t[0], t[-1])) if late else x
    return out
