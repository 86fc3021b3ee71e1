"""Tyre stiffness of a car - front longitudinal, front and rear cornering - from what every car measures.

    import pandas as pd, tse

    result = tse.estimate(pd.read_csv("log.csv"), "car.toml")      # a whole log
    f = tse.Filter("car.toml", sample_time=0.01)                   # row by row
    e = f.step(steer_angle=0.01, wheel_speed_front=60.2, wheel_speed_rear=60.1, accel_x=0.1, accel_y=1.2, yaw_rate=0.06)

SI units, ISO 8855: x forward, y left, z up; angles and rates are positive to the left. Stiffness is that of an axle. NaN is a
missing value. The numbers are those of the C library, bit for bit; names, units and ranges come from its tables.
"""

from __future__ import annotations

from tse._estimate import Result, estimate
from tse._filter import UNKNOWN_AGE, Filter, Form
from tse._simulate import Simulated, simulate
from tse._tables import CHANNELS, STIFFNESS, Estimate, Reason, Row, Status
from tse._vehicle import VehicleLike, read_vehicle
from tse.errors import Error, InputError, LearntError, SettingError
from tselab import __version__
from tselab.vehicle import Vehicle

__all__ = [
    "CHANNELS",
    "STIFFNESS",
    "UNKNOWN_AGE",
    "Error",
    "Estimate",
    "Filter",
    "Form",
    "InputError",
    "LearntError",
    "Reason",
    "Result",
    "Row",
    "SettingError",
    "Simulated",
    "Status",
    "Vehicle",
    "VehicleLike",
    "__version__",
    "estimate",
    "read_vehicle",
    "simulate",
]
