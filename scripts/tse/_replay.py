"""The car simulated along a log: what its sensors should have read."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd

from tse._log import LogLike, checked
from tse._shown import Shown, lines
from tse._vehicle import VehicleLike, read_vehicle
from tse.impl.core import Config, Replay
from tse.impl.errors import UserError
from tse.impl.rows import DRIVES, MEASURES

UNITS = {"accel_x": "m/s2", "accel_y": "m/s2", "yaw_rate": "rad/s"}


class Replayed(Shown):
    """What was measured, and what the car of the settings would have read."""

    def __init__(self, table: pd.DataFrame):
        self._table = table

    def to_frame(self) -> pd.DataFrame:
        """Return the rows: time, accel_x, accel_y, yaw_rate as logged, and simulated with the end _simulated; vel_x, vel_y."""
        return self._table

    @property
    def words(self) -> tuple[str, ...]:
        """How far they are apart: rms without the mean, which is the sensor's bias."""
        rms = {c: float((self._table[c] - self._table[f"{c}_simulated"]).std()) for c in MEASURES}
        return tuple(f"{c}: measured less simulated {rms[c]:.3g} {UNITS[c]} rms, without its mean" for c in MEASURES)

    def plot(self) -> Any:
        """Return a figure of plotly: measured and simulated over time."""
        t = self._table["time"]
        return lines([
            (f"{c} [{UNITS[c]}]", [(f"{c} measured", t, self._table[c]), (f"{c} simulated", t, self._table[f"{c}_simulated"])])
            for c in MEASURES
        ])  # fmt: skip


def replay(log: LogLike, vehicle: VehicleLike, *, settings: Mapping[str, float] | None = None) -> Replayed:
    """Simulate the car along a log: its steering angle and wheel speeds drive the single-track model, with the car's effects.

    Parameters
    ----------
    log
        A file, a frame, or what read_log() returned. Rows without a steering angle or wheel speed take the line between their
        neighbours.
    vehicle
        As in estimate().
    settings
        Any settings by name; they win.

    Returns
    -------
    Replayed
        Deterministic: no noise, constant stiffness, no bias.

    Raises
    ------
    Error
        Rows are more than 1 s apart, or a value is outside its range; a ValueError.
    """
    car = read_vehicle(vehicle)
    rows, config = checked(log, car), Config(car.values)
    for name, value in (settings or {}).items():
        config.set(name, value)
    inputs = {c: _whole(c, rows.data[c].to_numpy(float)) for c in DRIVES}
    simulated = Replay((*MEASURES, "vel_x", "vel_y"), dt=rows.dt, **inputs).run(config)
    table = {"time": rows.time, **{c: rows.data[c].to_numpy(float) for c in MEASURES}}
    ends = {name: "_simulated" if name in MEASURES else "" for name in simulated}
    return Replayed(pd.DataFrame(table | {f"{n}{ends[n]}": np.array(v, float) for n, v in simulated.items()}))


def _whole(name: str, value: np.ndarray[Any, np.dtype[np.float64]]) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Values without holes."""
    there = np.isfinite(value)
    if not there.any():
        raise UserError(f"{name} is missing: nothing drives the model")
    at = np.arange(len(value))
    return np.asarray(np.interp(at, at[there], value[there]))
