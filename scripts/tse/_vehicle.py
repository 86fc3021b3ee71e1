"""The car: a vehicle file, or a mapping with its keys."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping
from copy import deepcopy
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from tse.car.config import c_settings
from tse.car.vehicle import (
    Vehicle,
    list_sensor_settings,
    list_uncertainty_settings,
    list_vehicle_settings,
    make_vehicle,
)
from tse.car.vehicle import read_vehicle as _read
from tse.library.core import Config
from tse.library.errors import UserError
from tse.library.files import make_directory, write_atomically

VehicleLike: TypeAlias = "str | os.PathLike[str] | Mapping[str, Any] | Vehicle"


def read_vehicle(vehicle: VehicleLike) -> Vehicle:
    """Read a vehicle file, or a mapping with its keys, and fill in what they leave out.

        tse.read_vehicle({"mass": 1650, "lf": 1.2, "lr": 1.5, "wheel_radius_front": 0.32,
                          "wheel_radius_rear": 0.32, "latency": {"steer_angle": 0.02}})

    Parameters
    ----------
    vehicle
        Required are mass [kg], lf, lr [m] (centre of gravity to the axles),
        wheel_radius_front, wheel_radius_rear [m]. `tselab vehicle --example` shows the
        others, and the tables sensors, uncertainty, latency and effects.

    Returns
    -------
    Vehicle
        `values`, all settings by name; `filled`, a sentence for each value that a rule
        has filled in; `notes`.

    Raises
    ------
    FileNotFoundError
        The file is not there.
    Error
        A value outside its range, an unknown or a missing key; the message names them; a
        ValueError.
    """
    if isinstance(vehicle, Vehicle):
        return deepcopy(vehicle)
    if isinstance(vehicle, Mapping):
        made = make_vehicle(_copy_plain(vehicle), Path("vehicle"))
        made.path = None
        return made
    if not isinstance(vehicle, str | os.PathLike):
        raise TypeError(
            "vehicle: a file, a mapping with its keys or what read_vehicle() returned is needed, not "
            f"{type(vehicle).__name__}"
        )
    return _read(Path(vehicle))


def simulated_car() -> dict[str, Any]:
    """Return the car of simulate(), known exactly: for its logs, and for no real car.

        log, truth = tse.simulate("square-waves")
        result = tse.estimate(log, tse.simulated_car())

    Returns
    -------
    dict
        The keys of a vehicle file, as `tselab vehicle --simulated` prints it; every
        [uncertainty] is 0.
    """
    car = Config.exact()
    tables = {"uncertainty": list_uncertainty_settings(), "sensors": list_sensor_settings()}
    values: dict[str, Any] = {name: float(getattr(car, name)) for name in list_vehicle_settings()}
    return {
        "name": "mid-size car",
        "driven_axle": "front",
        **values,
        **{table: {name: float(getattr(car, name)) for name in names} for table, names in tables.items()},
    }


def write_c_settings(vehicle: VehicleLike, path: str | os.PathLike[str]) -> Path:
    """Write the settings of a car as a C header, for any number format.

    Parameters
    ----------
    vehicle
        As in read_vehicle().
    path
        The header; one that is there is replaced. After tse_config_default(&c), its
        tse_config_car(&c) gives the settings with which estimate() runs at 100 Hz.

    Returns
    -------
    Path
        The header.
    """
    with write_atomically(Path(path)) as file:
        file.write(c_settings(read_vehicle(vehicle)))
    return Path(path)


def check_names(settings: Mapping[str, float] | None) -> Mapping[str, float]:
    """Return settings by name. TypeError: they are not a mapping."""
    if settings is not None and not isinstance(settings, Mapping):
        raise TypeError(
            f"settings: names and numbers are needed, such as {{'valid_sd': 0.08}}, not "
            f"{type(settings).__name__}"
        )
    return settings or {}


def _copy_plain(value: Any) -> Any:
    """Return a copy with numbers of Python in place of NumPy's."""
    if isinstance(value, Mapping):
        return {str(k): _copy_plain(v) for k, v in value.items()}
    return value.item() if isinstance(value, np.generic) else deepcopy(value)


def get_vehicle_file(vehicle: VehicleLike, folder: Path) -> Path:
    """Return the vehicle file; for a mapping write one into the folder."""
    if isinstance(vehicle, Vehicle):
        if vehicle.path is None:
            raise UserError("a vehicle that is in no file: give the file, or a mapping with its keys")
        if changed := [k for k, v in _read(vehicle.path).values.items() if vehicle.values.get(k) != v]:
            raise UserError(
                f"{', '.join(changed)} of the vehicle are not those of {vehicle.path}: give a mapping "
                "with its keys"
            )
        return vehicle.path
    if not isinstance(vehicle, Mapping):
        return Path(vehicle)
    read_vehicle(vehicle)
    make_directory(folder)
    path = folder / "vehicle.toml"
    with write_atomically(path) as file:
        file.write("\n".join(_write_toml(_copy_plain(vehicle), "")) + "\n")
    return path


def _write_toml(table: Mapping[str, Any], name: str) -> Iterator[str]:
    """Yield the lines of a table and of the tables in it. JSON's values are TOML's."""
    for key, value in table.items():
        if not isinstance(value, Mapping):
            yield f"{json.dumps(key)} = {json.dumps(value, ensure_ascii=False)}"
    for key, value in table.items():
        if isinstance(value, Mapping):
            inner = f"{name}.{json.dumps(key)}" if name else json.dumps(key)
            yield f"[{inner}]"
            yield from _write_toml(value, inner)
