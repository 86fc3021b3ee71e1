"""From files and options to what a run needs: vehicle, log, settings, and what is to be said of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tselab.config import make_config
from tselab.core import Config
from tselab.log import Log, read_log, sampling_notes, steering_notes
from tselab.log import average as average_log
from tselab.units import check_units
from tselab.vehicle import Vehicle, fill_sensors, read_vehicle


@dataclass
class Prepared:
    """A run that may begin. `warnings` are among the notes."""

    vehicle: Vehicle
    log: Log
    config: Config
    notes: list[str]
    warnings: list[str]


def prepare(
    log_path: Path,
    vehicle_path: Path,
    config_path: Path | None,
    average: float | None,
    options: Mapping[str, Any],
    form: str,
    settings: Mapping[str, float],
) -> Prepared:
    """Read and check everything that a run of the estimator over a log needs."""
    return assemble(read_vehicle(vehicle_path), read_log(log_path), config_path, average, options, form, settings)


def assemble(
    vehicle: Vehicle,
    log: Log,
    config_path: Path | None,
    average: float | None,
    options: Mapping[str, Any],
    form: str,
    settings: Mapping[str, float],
    source: str = "option --set",
) -> Prepared:
    """The same of what is read. `vehicle` is filled in; `source` is where `settings` come from, for messages."""
    if average is not None:
        log = average_log(log, average)
    fill_sensors(vehicle, log)
    config, notes = make_config(vehicle, log, config_path, options, form)
    for key, value in settings.items():
        config.set(key, value, source=source)
    warnings = check_units(
        log,
        config.lf + config.lr,
        config.wheel_radius_front,
        config.wheel_radius_rear,
        vehicle.steering_ratio,
    )
    notes = [
        *warnings,
        *log.notes,
        *sampling_notes(log, config.max_gap),
        *steering_notes(log, config.max_steer),
        *notes,
        *vehicle.notes,
    ]
    return Prepared(vehicle, log, config, notes, warnings)
