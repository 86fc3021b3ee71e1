"""The car of the settings, simulated along a log: what its sensors should have read, and how far that is from what they did."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from tse.library.core import Config, Replay
from tse.library.errors import UserError
from tse.log.noise import estimate_channel_noise, fill_gaps
from tse.log.rows import DRIVES, MEASURES, ROAD_COLUMNS, CheckedLog
from tse.report.plots import CHANNEL_UNITS
from tse.roads.road import STEEPEST

SLOWEST = 3.0  # m/s: below it tyres and wheel speeds are another matter, and at rest all agrees
GRAVITY = 9.81  # m/s2, as the library has it
Values = np.ndarray[Any, np.dtype[np.float64]]


@dataclass(frozen=True)
class Apart:
    """How far measured and simulated are apart, above SLOWEST, and by channel."""

    rms: float  # without the mean, which is the sensor's bias; NaN: the log does not have it
    over_noise: float  # that over the white noise of the channel in this log
    mean: float
    unit: str


def along(log: CheckedLog, config: Config) -> pd.DataFrame:
    """Return time, accel_x, accel_y, yaw_rate as logged, and simulated with the end
    _simulated; vel_x, vel_y. The road is level but for columns bank and grade of the log,
    and the settings. Inputs are read as much later as the settings call them late, and
    what is simulated is as late as the settings call it."""
    late = {c: float(getattr(config, f"{c}_latency", 0.0)) for c in (*DRIVES, *MEASURES)}
    inputs = {c: log.data[c].to_numpy(float) for c in DRIVES}
    for c, x in inputs.items():
        if not np.isfinite(x).any():
            raise UserError(f"{c} is missing: nothing drives the model")
    inputs = {c: _later(log.time, fill_gaps(x), late[c]) for c, x in inputs.items()}
    config, road = _road(log, config, inputs)
    simulated = Replay((*MEASURES, "vel_x", "vel_y"), dt=log.dt, **inputs, **road).run(config)
    table = {"time": log.time, **{c: log.data[c].to_numpy(float) for c in MEASURES}}
    for name, x in simulated.items():
        table[f"{name}_simulated" if name in MEASURES else name] = _later(
            log.time, np.array(x, float), -late.get(name, 0.0)
        )
    return pd.DataFrame(table)


def _road(log: CheckedLog, config: Config, inputs: Mapping[str, Values]) -> tuple[Config, dict[str, Values]]:
    """Return settings and profiles of the road [rad]: what the log says of bank and
    grade, the whole of it, and the settings where it does not. The lean into curves of
    the settings is a bank of -share v r/g there."""
    given = {n: log.extra[n].to_numpy(float) for n in ROAD_COLUMNS if n in log.extra}
    profiles = {}
    if "grade" in given:
        profiles["grade"] = np.where(np.isfinite(given["grade"]), given["grade"] - config.grade_angle, 0.0)
    if "bank" in given:
        speed = config.wheel_radius_rear * inputs["wheel_speed_rear"]
        turn = fill_gaps(log.data["yaw_rate"].to_numpy(float)) if log.data["yaw_rate"].notna().any() else 0.0
        lean = np.clip(-config.bank_superelevation * speed * turn / GRAVITY, -STEEPEST, STEEPEST)
        profiles["bank"] = np.where(np.isfinite(given["bank"]), given["bank"] - config.bank_angle, lean)
        config = Config(config.as_dict())
        config.bank_superelevation = 0.0
    return config, profiles


def _later(time: Values, x: Values, by: float) -> Values:
    """What a channel is `by` seconds later."""
    return np.asarray(np.interp(time + by, time, x)) if by else x


def apart(table: pd.DataFrame) -> dict[str, Apart]:
    """Return how far each channel of along() is from what was measured."""
    fast = np.abs(table["vel_x"].to_numpy()) > SLOWEST
    found = {}
    for c in MEASURES:
        off = (table[c] - table[f"{c}_simulated"])[fast]
        noise = estimate_channel_noise(c, table[c].to_numpy(), fast)
        rms = float(off.std(ddof=0))
        found[c] = Apart(
            rms,
            rms / noise.unraised if noise and noise.unraised else np.nan,
            float(off.mean()),
            CHANNEL_UNITS[c],
        )
    return found


def sentences(found: Mapping[str, Apart]) -> tuple[str, ...]:
    """The same in words, a line per channel."""
    return tuple(
        f"{c}: measured less simulated {a.rms:.3g} {a.unit} rms above {SLOWEST:g} m/s, {_over(a)}without its mean of {a.mean:.2g}"
        if np.isfinite(a.rms)
        else f"{c}: nothing to compare above {SLOWEST:g} m/s"
        for c, a in found.items()
    )


def _over(a: Apart) -> str:
    return f"{a.over_noise:.1f} times its noise; " if np.isfinite(a.over_noise) else ""


def drawn(table: pd.DataFrame) -> list[tuple[str, list[tuple[str, Any, Any]]]]:
    """What plots.lines() draws of along(): a row per channel, measured and simulated."""
    t = table["time"]
    return [
        (
            f"{c} [{CHANNEL_UNITS[c]}]",
            [(f"{c} measured", t, table[c]), (f"{c} simulated", t, table[f"{c}_simulated"])],
        )
        for c in MEASURES
    ]
