"""Tyre stiffness of a car - front longitudinal, front and rear cornering - from what every car measures.

    import tse

    result = tse.estimate("drive.mf4", "car.toml")                 # a log, file or frame: result.words, .plot(), .report(path)
    tse.signals("drive.mf4").write("signals.toml")                 # which signal is which channel; read_log(), replay()
    calibration = tse.calibrate(["monday.mf4", "friday.mf4"], "car.toml")
    gap, fleet = tse.gap("drive.mf4", "car.toml"), tse.fleet("logs/", "car.toml", out="results")
    f = tse.Filter("car.toml", sample_time=0.01)                   # row by row; tse.live() reads a CAN bus while driving
    e = f.step(steer_angle=0.01, wheel_speed_front=60.2, wheel_speed_rear=60.1, accel_x=0.1, accel_y=1.2, yaw_rate=0.06)

SI units, ISO 8855: x forward, y left, z up; angles and rates are positive to the left. Stiffness is that of an axle. NaN is a
missing value. The numbers are those of the C library, bit for bit; names, units and ranges come from its tables.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from tse.library import __version__

if TYPE_CHECKING:
    from tse._calibrate import Calibration, calibrate
    from tse._estimate import Result, estimate
    from tse._filter import UNKNOWN_AGE, Filter, Form
    from tse._fleet import Fleet, fleet
    from tse._gap import Gap, gap
    from tse._live import Live, live
    from tse._log import Log, LogLike, Signals, read_log, signals
    from tse._simulate import Replayed, Simulated, replay, simulate
    from tse._tables import CHANNELS, STIFFNESS, Estimate, Reason, Row, Status
    from tse._vehicle import VehicleLike, read_vehicle, simulated_car
    from tse.car.vehicle import Vehicle
    from tse.errors import Error, InputError, LearntError, SettingError

__all__ = ["CHANNELS", "STIFFNESS", "UNKNOWN_AGE", "Calibration", "Error", "Estimate", "Filter", "Fleet", "Form", "Gap",
           "InputError", "LearntError", "Live", "Log", "LogLike", "Reason", "Replayed", "Result", "Row", "SettingError", "Signals",
           "Simulated", "Status", "Vehicle", "VehicleLike", "__version__", "calibrate", "estimate", "fleet", "gap", "live",
           "read_log", "read_vehicle", "replay", "signals", "simulate",
           "simulated_car"]  # fmt: skip

_LATER = {  # loaded by who uses it: the command is a user, too, and --help needs none of it
    **dict.fromkeys(("Calibration", "calibrate"), "tse._calibrate"),
    **dict.fromkeys(("Result", "estimate"), "tse._estimate"),
    **dict.fromkeys(("Filter", "Form", "UNKNOWN_AGE"), "tse._filter"),
    **dict.fromkeys(("Fleet", "fleet"), "tse._fleet"),
    **dict.fromkeys(("Gap", "gap"), "tse._gap"),
    **dict.fromkeys(("Live", "live"), "tse._live"),
    **dict.fromkeys(("Log", "LogLike", "read_log"), "tse._log"),
    **dict.fromkeys(("Replayed", "replay"), "tse._simulate"),
    **dict.fromkeys(("Signals", "signals"), "tse._log"),
    **dict.fromkeys(("Simulated", "simulate"), "tse._simulate"),
    **dict.fromkeys(("CHANNELS", "Estimate", "Reason", "Row", "STIFFNESS", "Status"), "tse._tables"),
    **dict.fromkeys(("VehicleLike", "read_vehicle", "simulated_car"), "tse._vehicle"),
    **dict.fromkeys(("Error", "InputError", "LearntError", "SettingError"), "tse.errors"),
    **dict.fromkeys(("Vehicle",), "tse.car.vehicle"),
}


def __getattr__(name: str) -> Any:
    if name not in _LATER:
        raise AttributeError(f"module 'tse' has no attribute {name!r}")
    try:
        globals()[name] = getattr(importlib.import_module(_LATER[name]), name)
    except ModuleNotFoundError as error:
        if (error.name or "").startswith("tse"):
            raise
        raise ModuleNotFoundError(
            f"tse.{name} needs the package {error.name}: pip install 'tse[lab]'", name=error.name
        ) from None
    return globals()[name]


def __dir__() -> list[str]:
    return __all__
