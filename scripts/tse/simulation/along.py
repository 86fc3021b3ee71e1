"""Simulate a car with the inputs of a log; compare simulated and measured channels."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from tse.car.vehicle import GRAVITY
from tse.library.core import Config, Replay
from tse.library.errors import UserError
from tse.log.noise import estimate_channel_noise, fill_gaps
from tse.log.rows import DRIVES, MEASURES, ROAD_COLUMNS, CheckedLog
from tse.report.plots import CHANNEL_UNITS
from tse.roads.road import MAX_ROAD_ANGLE

# [m/s] min speed of the rows in which measured and simulated channels are compared. In
# slower rows, tyre model and wheel speeds are inaccurate. At standstill, every model
# agrees with the measurement, so these rows would make a wrong model look good
MIN_COMPARE_SPEED = 3.0
Values = np.ndarray[Any, np.dtype[np.float64]]


@dataclass(frozen=True)
class ModelMisfit:
    """Statistics of a difference: measured minus simulated channel, in the rows with a
    speed above MIN_COMPARE_SPEED."""

    # rms of the difference about its mean, i.e. without the bias of the sensor. NaN: the
    # log has no values of the channel in these rows
    rms: float
    over_noise: float  # ratio of rms to the sd of the white noise of the channel in this log
    mean: float  # mean of the difference; it contains the bias of the sensor
    unit: str  # unit of rms and mean


def simulate_along(log: CheckedLog, config: Config) -> pd.DataFrame:
    """Simulate the model with the inputs of a log.

    Bank and grade of the road are read from the columns bank and grade of the log. If the
    log lacks these columns, the settings bank_angle and grade_angle are used. A logged
    input is shifted by its latency to the earlier time at which it acted. A simulated
    channel is delayed by the latency of the measured channel.

    Parameters
    ----------
    log
        Log with the inputs of the model.
    config
        Settings of the car.

    Returns
    -------
    Table with time, accel_x, accel_y and yaw_rate as logged, the simulated channels with
    the suffix _simulated, and simulated vel_x and vel_y.

    Raises
    ------
    UserError
        The log lacks an input.
    """
    late = {c: float(getattr(config, f"{c}_latency", 0.0)) for c in (*DRIVES, *MEASURES)}
    inputs = {c: log.data[c].to_numpy(float) for c in DRIVES}
    for c, x in inputs.items():
        if not np.isfinite(x).any():
            raise UserError(f"the log has no values of {c}: the simulation needs this channel as an input")
    inputs = {c: _shift_channel(log.time, fill_gaps(x), late[c]) for c, x in inputs.items()}
    config, road = _derive_road(log, config, inputs)
    simulated = Replay((*MEASURES, "vel_x", "vel_y"), dt=log.dt, **inputs, **road).run(config)
    table = {"time": log.time, **{c: log.data[c].to_numpy(float) for c in MEASURES}}
    for name, x in simulated.items():
        by = -late.get(name, 0.0)
        table[f"{name}_simulated" if name in MEASURES else name] = _shift_channel(
            log.time, np.array(x, float), by
        )
    return pd.DataFrame(table)


def _derive_road(
    log: CheckedLog, config: Config, inputs: Mapping[str, Values]
) -> tuple[Config, dict[str, Values]]:
    """Return the settings and, for each row, bank and grade [rad].

    The model adds the returned bank and grade to the settings bank_angle and grade_angle.
    In a row with a logged value, the returned value is logged value minus setting, so
    that the sum is the logged value. In a row without a logged grade, the grade is 0.

    A logged bank contains the effect of the setting bank_superelevation. So if the log
    has a column bank, this setting is returned as 0. In a row without a logged bank, the
    bank is that effect: -bank_superelevation v r/g, with speed v and yaw rate r.
    """
    given = {n: log.extra[n].to_numpy(float) for n in ROAD_COLUMNS if n in log.extra}
    profiles = {}
    if "grade" in given:
        profiles["grade"] = np.where(np.isfinite(given["grade"]), given["grade"] - config.grade_angle, 0.0)
    if "bank" in given:
        speed = config.wheel_radius_rear * inputs["wheel_speed_rear"]
        turn = fill_gaps(log.data["yaw_rate"].to_numpy(float)) if log.data["yaw_rate"].notna().any() else 0.0
        lean = np.clip(-config.bank_superelevation * speed * turn / GRAVITY, -MAX_ROAD_ANGLE, MAX_ROAD_ANGLE)
        profiles["bank"] = np.where(np.isfinite(given["bank"]), given["bank"] - config.bank_angle, lean)
        config = Config(config.as_dict())
        config.bank_superelevation = 0.0
    return config, profiles


def _shift_channel(time: Values, x: Values, by: float) -> Values:
    """Return, for each row, the value that a channel has `by` [s] after this row."""
    return np.asarray(np.interp(time + by, time, x)) if by else x


def measure_misfit(table: pd.DataFrame) -> dict[str, ModelMisfit]:
    """Return the misfit of each measured channel, from the table of simulate_along()."""
    fast = np.abs(table["vel_x"].to_numpy()) > MIN_COMPARE_SPEED
    found = {}
    for c in MEASURES:
        off = (table[c] - table[f"{c}_simulated"])[fast]
        noise = estimate_channel_noise(c, table[c].to_numpy(), fast)
        rms = float(off.std(ddof=0))
        over_noise = rms / noise.unraised if noise and noise.unraised else np.nan
        found[c] = ModelMisfit(rms, over_noise, float(off.mean()), CHANNEL_UNITS[c])
    return found


def describe_misfit(found: Mapping[str, ModelMisfit]) -> tuple[str, ...]:
    """Return the misfits as text, one string for each channel."""
    lines = []
    for c, a in found.items():
        if np.isfinite(a.rms):
            over = f"{a.over_noise:.1f} times the sensor noise; " if np.isfinite(a.over_noise) else ""
            lines.append(
                f"{c}: measured minus simulated: rms {a.rms:.3g} {a.unit} about the mean, {over}"
                f"mean {a.mean:.2g} {a.unit}; rows above {MIN_COMPARE_SPEED:g} m/s"
            )
        else:
            lines.append(f"{c}: not compared: the log has no values above {MIN_COMPARE_SPEED:g} m/s")
    return tuple(lines)


def list_curves(table: pd.DataFrame) -> list[tuple[str, list[tuple[str, Any, Any]]]]:
    """Return the plots of a figure, for plots.draw_lines(): for each channel one plot
    with the measured and the simulated values."""
    t = table["time"]
    return [
        (
            f"{c} [{CHANNEL_UNITS[c]}]",
            [(f"{c} measured", t, table[c]), (f"{c} simulated", t, table[f"{c}_simulated"])],
        )
        for c in MEASURES
    ]
