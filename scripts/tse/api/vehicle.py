"""Read a vehicle from a file or a mapping, and write it: read_vehicle(),
simulated_car(), write_c_settings()."""

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
    """Read a vehicle file, or a mapping with its keys. Fill in values that are left out.

        tse.read_vehicle({"mass": 1650, "lf": 1.2, "lr": 1.5, "wheel_radius_front": 0.32,
                          "wheel_radius_rear": 0.32, "latency": {"steer_angle": 0.02}})

    Parameters
    ----------
    vehicle
        Required keys are mass [kg], lf, lr (distances from the centre of gravity to
        the axles [m]), wheel_radius_front and wheel_radius_rear [m]. `tselab
        vehicle --example` shows the optional keys, and the tables sensors,
        uncertainty, latency and effects.

    Returns
    -------
    Vehicle
        The car. `values` has all settings by name. `filled` has a sentence for each value
        that was left out, with the value that is used for it and the reason. `notes` has
        further sentences.

    Raises
    ------
    FileNotFoundError
        The file does not exist.
    Error
        A value is outside its range, or a key is unknown or missing. The message names
        them. The error is also a ValueError.
    """
    if isinstance(vehicle, Vehicle):
        return deepcopy(vehicle)
    if isinstance(vehicle, Mapping):
        made = make_vehicle(_copy_plain(vehicle), Path("vehicle"))
        made.path = None
        return made
    if not isinstance(vehicle, str | os.PathLike):
        raise TypeError(
            f"vehicle: {type(vehicle).__name__} cannot be a vehicle; give a file, a mapping with its keys "
            "or the result of read_vehicle()"
        )
    return _read(Path(vehicle))


def simulated_car() -> dict[str, Any]:
    """Return the car of simulate(), with parameters that are exactly known. Use it for
    simulated logs only: the parameters of a real car are uncertain, so its stiffness
    intervals would be too narrow.

        log, truth = tse.simulate("square-waves")
        result = tse.estimate(log, tse.simulated_car())

    Returns
    -------
    dict
        The keys of the vehicle file that `tselab vehicle --simulated` prints. Every value
        of its table uncertainty is 0.
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
    """Write the settings of a car as a C header, for the library in any number format.

    Parameters
    ----------
    vehicle
        As in read_vehicle().
    path
        The header. An existing file is replaced. It defines tse_config_car(&c), to be
        called after tse_config_default(&c). At other rates than 100 rows per second, also
        set c.sample_time. The settings are those of estimate(), except for noise and
        biases that the vehicle does not state: they keep their defaults, while estimate()
        estimates them from the log.

    Returns
    -------
    Path
        `path`.
    """
    with write_atomically(Path(path)) as file:
        file.write(c_settings(read_vehicle(vehicle)))
    return Path(path)


def check_names(settings: Mapping[str, float] | None) -> Mapping[str, float]:
    """Return the settings, or an empty mapping for None. Raise TypeError if they are
    not a mapping."""
    if settings is not None and not isinstance(settings, Mapping):
        raise TypeError(
            f"settings: {type(settings).__name__} is not a mapping; give names and numbers, such as "
            "{'valid_sd': 0.08}"
        )
    return settings or {}


def _copy_plain(value: Any) -> Any:
    """Return a copy of nested mappings with NumPy's numbers converted to Python's."""
    if isinstance(value, Mapping):
        return {str(k): _copy_plain(v) for k, v in value.items()}
    return value.item() if isinstance(value, np.generic) else deepcopy(value)


def get_vehicle_file(vehicle: VehicleLike, folder: Path) -> Path:
    """Return the path of a file with the content of `vehicle`. A path is returned
    unchanged. For a Vehicle, return the path of the file that it was read from. Write a
    mapping to vehicle.toml in `folder`.

    Raise UserError if a Vehicle was not read from a file, or if its values differ from
    those in this file."""
    if isinstance(vehicle, Vehicle):
        if vehicle.path is None:
            raise UserError("the vehicle is not read from a file: give a file or a mapping with its keys")
        if changed := [k for k, v in _read(vehicle.path).values.items() if vehicle.values.get(k) != v]:
            raise UserError(
                f"{', '.join(changed)} of the vehicle differ from {vehicle.path}: give the changed file, or "
                "a mapping with its keys"
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
    """Yield the lines of a TOML table and of its subtables. Values are written as JSON,
    which is valid TOML for numbers, strings and lists.

    `name`: name of the table; empty for the top level."""
    for key, value in table.items():
        if not isinstance(value, Mapping):
            yield f"{json.dumps(key)} = {json.dumps(value, ensure_ascii=False)}"
    for key, value in table.items():
        if isinstance(value, Mapping):
            inner = f"{name}.{json.dumps(key)}" if name else json.dumps(key)
            yield f"[{inner}]"
            yield from _write_toml(value, inner)
