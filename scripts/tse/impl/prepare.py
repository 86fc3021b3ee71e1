"""From files and options to what a run needs: vehicle, log, settings, and what is to be said of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from tse.impl.calibrate.own import STOPPED, Own, calibrated, of_class, uncalibrated
from tse.impl.config import make_config
from tse.impl.core import Config
from tse.impl.errors import UserError
from tse.impl.log import read_log
from tse.impl.rows import Log, Reading, liveliest, sampling_notes, steering_notes
from tse.impl.rows import average as average_log
from tse.impl.units import check_car, stood
from tse.impl.vehicle import Vehicle, average_sensors, fill_sensors, read_vehicle

MOST_ROWS = (
    1 << 19
)  # from which noise and units are found: 87 minutes at 100 Hz; a longer log is as its liveliest so many rows


@dataclass
class Prepared:
    """A run that may begin. `warnings` are among the notes: in what the channels contradict each other. `own`: what a calibration
    on the log itself has found."""

    vehicle: Vehicle
    log: Log
    config: Config
    notes: list[str]
    warnings: list[str]
    own: Own | None = None


@dataclass(frozen=True)
class Calibrate:
    """That a car which nobody has calibrated is calibrated on the log itself. `others`: more logs of the same car; `goes_on`:
    Ctrl-C ends the calibration alone, and the estimate is that of an ordinary car."""

    say: Callable[[str], None] = lambda _: None
    others: Sequence[Log] = ()
    goes_on: bool = False


def prepare(
    log_path: Path,
    vehicle_path: Path,
    config_path: Path | None,
    average: float | None,
    options: Mapping[str, Any],
    form: str,
    settings: Mapping[str, float],
    reading: Reading | None = None,
    calibrate: Calibrate | None = None,
) -> Prepared:
    """Read and check everything that a run of the estimator over a log needs."""
    vehicle = read_vehicle(vehicle_path)
    reading = replace(reading or Reading(), car=vehicle)
    log = read_log(log_path, reading=reading)
    strict = reading.strict
    return assemble(vehicle, log, config_path, average, options, form, settings, strict=strict, calibrate=calibrate)


def assemble(
    vehicle: Vehicle,
    log: Log,
    config_path: Path | None,
    average: float | None,
    options: Mapping[str, Any],
    form: str,
    settings: Mapping[str, float],
    source: str = "option --set",
    strict: bool = False,
    calibrate: Calibrate | None = None,
) -> Prepared:
    """The same of what is read. `vehicle` is filled in; `source` is where `settings` come from, for messages; `strict`: refuse
    what else is a warning; `calibrate`: what is done with a car that nobody has calibrated."""
    stated, logged = deepcopy(vehicle), log
    if average is not None:
        log = average_log(log, average)
    lively = liveliest(log, MOST_ROWS)
    log.let_go()
    if form == "default":
        average_sensors(vehicle, lively)  # the rest the filter finds while driving
    else:
        fill_sensors(vehicle, lively)
    config, notes = make_config(vehicle, log, config_path, options, form)
    for key, value in settings.items():
        config.set(key, value, source=source)
    warnings = check_car(lively, vehicle, config)
    if strict and warnings:
        raise UserError(f"{log.path}: option --strict: {'; '.join(warnings)}")
    if calibrate is not None and form == "default" and uncalibrated(stated):
        if warnings:
            found = of_class("its channels contradict each other")
        else:
            try:
                found = calibrated(stated, [logged, *calibrate.others], calibrate.say)
            except KeyboardInterrupt:
                if not calibrate.goes_on:
                    raise
                found = of_class(STOPPED)
        made = assemble(found.vehicle(stated), log, config_path, None, options, form, settings, source)
        return replace(made, own=found)
    notes = [
        *warnings,
        *stood(lively, config.wheel_radius_front, config.wheel_radius_rear, config.hold_speed),
        *log.notes,
        *sampling_notes(log, config.max_gap),
        *steering_notes(log, config.max_steer),
        *notes,
        *vehicle.notes,
    ]
    log.let_go()
    return Prepared(vehicle, log, config, notes, warnings)
