"""The car, as a file or as what stands in one."""

from __future__ import annotations

import os
from collections.abc import Mapping
from copy import deepcopy
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from tselab.vehicle import Vehicle, make_vehicle
from tselab.vehicle import read_vehicle as _read

VehicleLike: TypeAlias = "str | os.PathLike[str] | Mapping[str, Any] | Vehicle"


def read_vehicle(vehicle: VehicleLike) -> Vehicle:
    """A vehicle file, or a mapping with its keys: what stands in it, and what a rule fills in.

    Needed are mass [kg], lf, lr [m] (centre of gravity to the axles), wheel_radius_front, wheel_radius_rear [m]. The others, and
    the tables sensors, uncertainty, latency and effects, are as `tselab vehicle --example` shows them:

        tse.read_vehicle({"mass": 1650, "lf": 1.2, "lr": 1.5, "wheel_radius_front": 0.32, "wheel_radius_rear": 0.32,
                          "latency": {"steer_angle": 0.02}})

    Returned: `values`, all settings by name; `filled`, a sentence for each that a rule has filled in; `notes`.
    Refused (Error): a value outside its range, a key that nobody knows, one that is missing; the message names them.
    """
    if isinstance(vehicle, Vehicle):
        return deepcopy(vehicle)
    if isinstance(vehicle, Mapping):
        made = make_vehicle(_plain(vehicle), Path("vehicle"))
        made.path = None
        return made
    return _read(Path(vehicle))


def _plain(value: Any) -> Any:
    """A copy, with NumPy's numbers as Python's."""
    if isinstance(value, Mapping):
        return {str(k): _plain(v) for k, v in value.items()}
    return value.item() if isinstance(value, np.generic) else deepcopy(value)
