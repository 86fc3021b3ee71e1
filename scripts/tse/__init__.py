"""Estimate the tyre stiffness of a car (front longitudinal, front and rear cornering)
from sensors that every car has.

    import tse

    # a whole log: a file or a data frame
    result = tse.estimate("drive.mf4", "car.toml")
    result.words, result.plot(), result.report("page.html")
    # propose which signals of a log contain the inputs of the filter (its channels)
    tse.signals("drive.mf4").write("signals.toml")
    # fit the car, find effects that the model lacks, estimate the logs of many cars
    calibration = tse.calibrate(["monday.mf4", "friday.mf4"], "car.toml")
    gap = tse.gap("drive.mf4", "car.toml")
    fleet = tse.fleet("logs/", "car.toml", out="results")
    # row by row; tse.live() does the same with the frames of a CAN bus
    f = tse.Filter("car.toml", sample_time=0.01)
    e = f.step(steer_angle=0.01, wheel_speed_front=60.2, wheel_speed_rear=60.1,
               accel_x=0.1, accel_y=1.2, yaw_rate=0.06)

SI units, ISO 8855: x forward, y left, z up; angles and rates are positive to the left.
Every stiffness is the sum over both tyres of an axle. NaN is a missing value. The C
library computes all estimates, so they have the same bits as in C. tse.tables lists the
settings and the channels with units and ranges. tse.errors has the exceptions. tse.files
has the functions with which `tselab` writes files; other programs may use them, too.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from tse.library import __version__

if TYPE_CHECKING:
    from tse import errors, files, tables
    from tse.api.calibrate import Calibration, calibrate
    from tse.api.estimate import Result, estimate
    from tse.api.filter import UNKNOWN_AGE, Filter, Form
    from tse.api.fleet import Fleet, fleet
    from tse.api.formula import read_formula, write_c_formula
    from tse.api.gap import Gap, GapCheck, GapPlan, gap, gap_check, gap_plan
    from tse.api.generated import CHANNELS, STIFFNESS, Estimate, Reason, Row, Status
    from tse.api.live import Live, live
    from tse.api.log import Log, LogLike, Signals, read_log, signals
    from tse.api.simulate import Replayed, Simulated, replay, simulate
    from tse.api.vehicle import VehicleLike, read_vehicle, simulated_car, write_c_settings
    from tse.car.formula import Formula
    from tse.car.vehicle import Vehicle
    from tse.errors import Error, InputError, Interrupted, LearntError, SettingError
    from tse.log.rows import Reading

__all__ = [
    "CHANNELS",
    "STIFFNESS",
    "UNKNOWN_AGE",
    "Calibration",
    "Error",
    "Estimate",
    "Filter",
    "Fleet",
    "Form",
    "Formula",
    "Gap",
    "GapCheck",
    "GapPlan",
    "InputError",
    "Interrupted",
    "LearntError",
    "Live",
    "Log",
    "LogLike",
    "Reading",
    "Reason",
    "Replayed",
    "Result",
    "Row",
    "SettingError",
    "Signals",
    "Simulated",
    "Status",
    "Vehicle",
    "VehicleLike",
    "__version__",
    "calibrate",
    "errors",
    "estimate",
    "files",
    "fleet",
    "gap",
    "gap_check",
    "gap_plan",
    "live",
    "read_formula",
    "read_log",
    "read_vehicle",
    "replay",
    "signals",
    "simulate",
    "simulated_car",
    "tables",
    "write_c_formula",
    "write_c_settings",
]

_MODULES = ("errors", "files", "tables")
# Key: public name. Value: module that defines it. A module is imported when one of its
# names is first used. So `tselab --help`, which imports tse, does not wait for numpy and
# pandas.
_LATER = {
    **dict.fromkeys(("Calibration", "calibrate"), "tse.api.calibrate"),
    **dict.fromkeys(("Result", "estimate"), "tse.api.estimate"),
    **dict.fromkeys(("Filter", "Form", "UNKNOWN_AGE"), "tse.api.filter"),
    **dict.fromkeys(("Fleet", "fleet"), "tse.api.fleet"),
    **dict.fromkeys(("read_formula", "write_c_formula"), "tse.api.formula"),
    **dict.fromkeys(("Gap", "GapCheck", "GapPlan", "gap", "gap_check", "gap_plan"), "tse.api.gap"),
    **dict.fromkeys(("Live", "live"), "tse.api.live"),
    **dict.fromkeys(("Log", "LogLike", "Signals", "read_log", "signals"), "tse.api.log"),
    **dict.fromkeys(("Replayed", "Simulated", "replay", "simulate"), "tse.api.simulate"),
    **dict.fromkeys(("CHANNELS", "Estimate", "Reason", "Row", "STIFFNESS", "Status"), "tse.api.generated"),
    **dict.fromkeys(("VehicleLike", "read_vehicle", "simulated_car", "write_c_settings"), "tse.api.vehicle"),
    **dict.fromkeys(("Error", "InputError", "Interrupted", "LearntError", "SettingError"), "tse.errors"),
    "Formula": "tse.car.formula",
    "Reading": "tse.log.rows",
    "Vehicle": "tse.car.vehicle",
}


def __getattr__(name: str) -> Any:
    if name in _MODULES:
        return importlib.import_module(f"tse.{name}")
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
