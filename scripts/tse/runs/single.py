"""Prepare vehicle, log and settings, and run the estimator on one log. tse.estimate()
calls these functions, and tse.fleet() calls them for each log."""

from collections.abc import Callable, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from tse.calibration.own import (
    NOT_ASKED,
    STOPPED,
    OwnCalibration,
    calibrate_once,
    is_uncalibrated,
    keep_class,
)
from tse.car.config import check_effect, make_config, unused_notes
from tse.car.vehicle import Vehicle, average_sensors, fill_sensors, read_vehicle
from tse.channels.agree import (
    MAX_CHECKED_ROWS,
    PERHAPS,
    check_car,
    check_lateral_delay,
    find_false_stops,
    select_certain,
)
from tse.channels.log import read_log
from tse.estimation import regimes
from tse.estimation.estimate import Estimates, Learnt, estimate, estimate_to
from tse.estimation.regimes import Change
from tse.estimation.verdict import (
    Finding,
    check_steering_lag,
    describe_implausible,
    list_contradictions,
    list_remarks,
    list_uncertain_parameters,
    make_findings,
)
from tse.library.core import Config
from tse.library.errors import UserError
from tse.log.rows import CheckedLog, Reading, describe_sampling, describe_steering, select_liveliest
from tse.log.rows import average as average_log
from tse.roads.road import Road


@dataclass
class Prepared:
    """A run that is prepared: all inputs of the estimator, and the results
    of the checks."""

    vehicle: Vehicle
    log: CheckedLog
    config: Config
    notes: list[str]  # sentences of all checks; `warnings` and `doubts` are among them
    warnings: list[str]  # contradictions between channels, implausible mass or axles; if any, no row is valid
    # possible contradictions, between channels or between log and vehicle file. If the
    # estimates show that channels contradict each other, all doubts become warnings
    doubts: list[str] = field(default_factory=list)
    # result of calibrating the car on the log itself; None: no calibration was tried
    own: OwnCalibration | None = None


@dataclass(frozen=True)
class Calibrate:
    """Options of the calibration of an uncalibrated car on the log itself."""

    say: Callable[[str], None] = lambda _: None  # called with a sentence about the current step
    others: Sequence[CheckedLog] = ()  # further logs of the same car
    # what happens after Ctrl-C during the calibration. True: the log is estimated with
    # parameters that are typical of cars with the same mass and axle distances. False:
    # KeyboardInterrupt is raised
    goes_on: bool = False


def prepare_run(
    log_path: Path,
    vehicle_path: Path,
    config_path: Path | None,
    average: float | None,
    options: Mapping[str, Any],
    form: str,
    settings: Mapping[str, float],
    reading: Reading | None = None,
    calibrate: Calibrate | None = None,
    road: Road | None = None,
) -> Prepared:
    """Read and check vehicle file and log, and prepare the run. For the arguments see
    assemble_run()."""
    vehicle = read_vehicle(vehicle_path)
    reading = replace(reading or Reading(), car=vehicle)
    log = read_log(log_path, reading=reading)
    strict = reading.strict
    return assemble_run(
        vehicle,
        log,
        config_path,
        average,
        options,
        form,
        settings,
        strict=strict,
        calibrate=calibrate,
        road=road,
    )


def assemble_run(
    vehicle: Vehicle,
    log: CheckedLog,
    config_path: Path | None,
    average: float | None,
    options: Mapping[str, Any],
    form: str,
    settings: Mapping[str, float],
    source: str = "option --set",
    strict: bool = False,
    calibrate: Calibrate | None = None,
    road: Road | None = None,
) -> Prepared:
    """Check vehicle, log and settings against each other, and prepare the run.

    `vehicle`: the car; this function fills in its missing values. `config_path`: file
    of settings, or None. `average`: [s] length of the blocks over which the log is
    averaged; None: no averaging. `options`: settings by name; a setting whose value is
    None keeps its value from the file or the vehicle. `form`: name of the filter, such as
    "default". `settings`: settings that override all others. `source`: where `settings`
    come from, for messages. `strict`: raise UserError if channels contradict each other.
    `calibrate`: options of the calibration: an uncalibrated car is calibrated on the log
    before the run; None: no calibration. `road`: road whose bank and grade the filter
    uses; None: the filter uses the columns bank and grade of the log, if it has them."""
    stated, logged = deepcopy(vehicle), log
    if average is not None:
        log = average_log(log, average)
    level = log
    if road is not None:
        if form != "default":
            raise UserError(f"{road.path}: form {form} cannot use a road: use the default form")
        from tse.roads.road_match import add_road  # imports scipy, which is slow

        log, profile = add_road(log, road, Config.exact(vehicle.values))
    lively = select_liveliest(log, MAX_CHECKED_ROWS)
    if form == "default":
        average_sensors(vehicle, lively)  # missing noise sds stay missing: the default filter estimates them
    else:
        fill_sensors(vehicle, lively)
    config, notes = make_config(vehicle, log, config_path, options, form)
    if road is not None and np.isfinite(profile.sd) and config.road_sd == config.fields["road_sd"].default:
        config.set("road_sd", min(profile.sd, config.fields["road_sd"].high))
    for key, value in settings.items():
        config.set(key, value, source=source)
    notes += unused_notes(config, settings)
    check_effect([*settings, *(key for key, value in options.items() if value is not None)], config)
    said = check_car(lively, vehicle, config)
    if strict and said:
        raise UserError(f"{log.path}: option --strict: {'; '.join(said)}")
    if calibrate is not None and form == "default" and is_uncalibrated(stated):
        if said:
            found = keep_class(f"its channels {'' if select_certain(said) else PERHAPS}contradict each other")
        else:
            try:
                found = calibrate_once(stated, [logged, *calibrate.others], calibrate.say)
            except KeyboardInterrupt:
                if not calibrate.goes_on:
                    raise
                found = keep_class(STOPPED)
        made = assemble_run(
            found.apply_to(stated),
            level,
            config_path,
            None,
            options,
            form,
            settings,
            source,
            strict,
            road=road,
        )
        if wrong := found.found.get("wrong"):
            made.notes.insert(0, f"check the vehicle file: on this log {wrong}")
            made.doubts.append(made.notes[0])
        return replace(made, own=found)
    if form == "default" and is_uncalibrated(stated) and not vehicle.found:
        vehicle.found.append(NOT_ASKED)
    late = [] if said or form != "default" else check_lateral_delay(lively, config)
    if strict and late:
        raise UserError(f"{log.path}: option --strict: {late[0]}")
    notes = [
        *said,
        *late,
        *find_false_stops(lively, config.wheel_radius_front, config.wheel_radius_rear, config.hold_speed),
        *log.notes,
        *describe_sampling(log, config.max_gap),
        *describe_steering(log, config.max_steer),
        *notes,
        *vehicle.notes,
    ]
    warnings = [*select_certain(said), *late, *vehicle.wrong]
    return Prepared(vehicle, log, config, notes, warnings, [w for w in said if w not in warnings])


# ---- the run


@dataclass
class Run:
    """Result of a run."""

    estimate: Estimates
    changes: list[Change]
    findings: list[Finding]
    notes: list[str]  # sentences from the preparation and from the run
    reported: bool  # whether the report was written
    # path and age of the learnt state from which the filter started; None: the filter
    # started without a learnt state
    started_from: str | None = None


def run_prepared(
    prepared: Prepared,
    out: Path | None,
    report: Path | None,
    learnt: Learnt | None = None,
    progress: bool = False,
    whole: bool = False,
) -> Run:
    """Run the estimator. Write the estimates to the file `out` and the HTML report to the
    file `report`. A file that is None is not written.

    If the estimates show that channels contradict each other (find_contradiction()), no
    estimate can be trusted. The estimator then runs again and marks every row as not
    valid, including the rows before the contradiction.

    `learnt`: learnt state from which the filter starts. `progress`: show a progress bar.
    `whole`: True: keep all rows and columns in memory, and do not write `out`. False:
    keep only a summary."""

    def estimate_once() -> tuple[Estimates, Any]:
        contradicted = bool(prepared.warnings)
        if whole:
            return estimate(prepared.log, prepared.config, progress, learnt, contradicted), None
        drawn = None
        if report is not None:
            from tse.report.plots import Data

            drawn = Data(prepared.log)
        watch = [drawn.add] if drawn else []
        return estimate_to(out, prepared.log, prepared.config, progress, learnt, watch, contradicted), drawn

    est, drawn = estimate_once()
    if find_contradiction(prepared, est.table) and not est.interrupted:
        est, drawn = estimate_once()
    notes = collect_notes(prepared, est)
    changes = regimes.find_changes(est.table)
    found = make_findings(est.table, prepared.config, changes, prepared.warnings, est.uncertainty_sd)
    if report is not None and len(est):
        from tse.report.report import write_report

        write_report(
            report,
            est,
            prepared.log,
            prepared.vehicle,
            prepared.config,
            notes,
            drawn,
            judged=(changes, found),
        )
    note = learnt.note if learnt is not None else None
    return Run(est, changes, found, notes, report is not None and len(est) > 0, note)


def find_contradiction(prepared: Prepared, table: pd.DataFrame) -> bool:
    """Return whether the estimates show that channels contradict each other. Return False
    if `prepared` has a warning of a contradiction already.

    If True is returned, add to `prepared.warnings`: the possible contradictions
    (Prepared.doubts) or, if there are none, the contradiction in the estimates."""
    late = check_steering_lag(table, prepared.config)
    said = (
        ""
        if prepared.warnings
        else describe_implausible(table) or (f"check steer_angle: {late[0]}" if late else "")
    )
    if said and prepared.doubts:
        prepared.warnings += prepared.doubts
        prepared.doubts = []
    elif said:
        prepared.warnings.append(said)
        prepared.notes.insert(0, said)
    return bool(said)


def collect_notes(prepared: Prepared, est: Estimates) -> list[str]:
    """Return all notes of a run: those of the preparation, and those about refused rows
    and about the estimates."""
    notes = list(prepared.notes)
    refused = sum(rows for status, rows in est.statuses.items() if status < 0)
    if refused:
        notes.append(
            f"{refused} rows were refused by the library: they have no estimates, and their status gives the "
            "reason"
        )
    return [
        *notes,
        *list_remarks(est.table),
        *(list_contradictions(est.table) if not prepared.warnings else []),
        *(check_steering_lag(est.table, prepared.config) if not prepared.warnings else []),
        *list_uncertain_parameters(est.table, prepared.config, est.uncertainty_sd),
    ]
