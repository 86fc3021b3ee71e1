"""Estimate a whole log."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np
import numpy.typing as npt
import pandas as pd

from tse._base import Array
from tse._filter import UNKNOWN_AGE, Filter, Form, check_form
from tse._log import Log, LogLike, PathLike, read_checked, read_known_road
from tse._shown import Shown, make_figure
from tse._tables import STIFFNESS
from tse._vehicle import VehicleLike, check_names, read_vehicle
from tse.calibration.own import STOPPED
from tse.car.vehicle import Vehicle
from tse.estimation import regimes
from tse.estimation.answer import make_answer
from tse.estimation.estimate import (
    Estimates,
    Learnt,
    list_est_columns,
    read_learnt,
    write_estimates,
    write_learnt,
)
from tse.estimation.verdict import Finding, make_findings
from tse.library.core import Config
from tse.library.errors import UserError
from tse.log.rows import Reading
from tse.report import plots, results
from tse.roads.road import Road
from tse.runs.single import Calibrate, Prepared, Run, assemble_run, run_prepared

Usable: TypeAlias = Literal["yes", "in part", "no"]
USABLE: dict[int, Usable] = {results.USABLE: "yes", results.IN_PART: "in part", results.NOTHING: "no"}


@dataclass(frozen=True, repr=False)
class Result(Shown):
    """Estimates of n rows, and what the run found."""

    table: pd.DataFrame
    """n rows with the columns of `tselab estimate` (its --help lists units): time, vel_x,
    cy_front, cy_front_sd, p_changed ... Columns _valid and _spread_seen are booleans,
    columns _reason are words. Of a run with `out` it has the columns that `words` needs,
    and of a very long log every n-th row."""
    settings: dict[str, float | int]
    """All settings of the run, by name: also those that were found in the log."""
    notes: tuple[str, ...] = ()
    """What was odd, or was filled in, in words."""
    warnings: tuple[str, ...] = ()
    """How the channels contradict each other (units, signs, axes), in words. The filter
    cannot distinguish a permanently wrong channel from a different car, so no row of such
    a log is valid and no stiffness is usable."""
    learnt: bytes | None = None
    """The learnt state, for the next drive: for the argument `learnt`,
    Filter.load_learnt() and tse_learnt_load() in C. None: no row was used, or the
    channels contradict each other."""
    uncertainty_sd: dict[str, npt.NDArray[np.float64]] = field(default_factory=dict)
    """Share of the final sd that each uncertain parameter of the car adds: (3,), relative
    to nominal."""
    calibration: dict[str, Any] | None = None
    """Result of the calibration on the log itself: used (else why not), seconds,
    stiffness with its 95 % interval [N/rad], latency [s], not_shown. None: the car was
    calibrated before, or this was switched off."""
    vehicle: Vehicle | None = None
    """The car that was used, to which `learnt` belongs: estimate(next, result.vehicle,
    learnt=result.learnt)."""
    _ran: tuple[Run, Prepared] | None = field(default=None, repr=False, compare=False)

    def __len__(self) -> int:
        return len(self.table)

    @property
    def time(self) -> Array:
        """(n,) s, as in the log."""
        return self.table["time"].to_numpy(float)

    def _three(self, end: str) -> Array:
        return self.table[[f"{s}{end}" for s in STIFFNESS]].to_numpy(float)

    @property
    def stiffness(self) -> Array:
        """(n, 3) means: cx_front [N], cy_front, cy_rear [N/rad]."""
        return self._three("")

    @property
    def stiffness_sd(self) -> Array:
        """(n, 3) standard deviations of these means, in their units."""
        return self._three("_sd")

    @property
    def stiffness_secant(self) -> Array:
        """(n, 3) secant stiffness, in the same units: force over slip at the slip and
        load of each row. Its relative sd is that of `stiffness`."""
        return self._three("_secant")

    @property
    def stiffness_spread(self) -> Array:
        """(n, 3) standard deviations of the stiffness from sample to sample, in the same
        units; of the default form: size of the model discrepancy, as a stiffness."""
        return self._three("_spread")

    @property
    def valid(self) -> npt.NDArray[np.bool_]:
        """(n, 3) True where the stiffness may be used."""
        return self.table[[f"{s}_valid" for s in STIFFNESS]].to_numpy(bool)

    @property
    def reason(self) -> npt.NDArray[np.object_]:
        """(n, 3) "valid", or the reason why the stiffness may not be used."""
        return np.column_stack([self.table[f"{s}_reason"].astype(str).to_numpy(object) for s in STIFFNESS])

    @property
    def status(self) -> npt.NDArray[np.int64]:
        """(n,) codes of tse.Status; below 0: the row was refused."""
        return self.table["status"].to_numpy(np.int64)

    @property
    def words(self) -> tuple[str, ...]:
        """The result in sentences, as `tselab estimate --verbose` ends.

        For an uncalibrated car the first sentence is the stiffness that the calibration
        on the log itself found, or that there was none. C, FMU, page and Filter do not
        calibrate on the log."""
        itself = self.vehicle.found[:1] if self.vehicle is not None else []
        return (*itself, *(line for lines in self.stretch_words for line in lines))

    @property
    def stretch_words(self) -> tuple[tuple[str, ...], ...]:
        """Sentences for each stretch of road between changes."""
        return tuple(tuple(f.lines()) for f in self._found()[0])

    @property
    def answer(self) -> tuple[str, ...]:
        """Three lines: each stiffness with its 95 % interval, and whether to act on it;
        of a road that changed three for each of the last stretches. `repr()` says the
        same."""
        return tuple(make_answer(self._found()[0], self._config()))

    def __repr__(self) -> str:
        return "\n".join(self.answer)

    @property
    def usable(self) -> Usable:
        """ "yes": every stiffness is usable; "in part"; "no": none is. The exit code of
         `tselab estimate`
        says the same."""
        return USABLE[self.exit_code]

    @property
    def exit_code(self) -> int:
        """Exit code of the command: 0 usable, 3 usable in part, 4 nothing usable."""
        return results.choose_exit_code(self._found()[0])

    @property
    def stretches(self) -> pd.DataFrame:
        """Estimates as `tselab estimate --table` writes them: a row per stretch of road
        between changes and stiffness.

        start, end [s]; value at the end of the stretch with its sd and 95 % interval low
        .. high [N, N/rad], also where no row is valid; smoothed over the stretch with
        smoothed_sd, smoothed_low .. smoothed_high and smoothed_reason ("valid", or why
        not to act on it); valid (share of the rows), usable, reason, change,
        change_probability, ratio, text."""
        return results.make_frame(self._rows(Path(), self.warnings), results.COLUMNS).drop(columns="log")

    @property
    def events(self) -> tuple[str, ...]:
        """What happened on the way, a sentence each: changes of the road, faults of
        sensors, sliding."""
        table = self._estimated().table
        return tuple(regimes.describe_events(self._found()[1], regimes.find_spells(table)))

    @property
    def facts(self) -> tuple[tuple[str, str], ...]:
        """Log, vehicle and filter of the run: a name and a value each."""
        ran, ready = self._of_run()
        return tuple(results.list_run_facts(ran.estimate, ready.log, ready.vehicle, ready.config))

    @property
    def messages(self) -> tuple[str, ...]:
        """`warnings` and `notes` of the run in the order of the command, without what was
        filled in."""
        return tuple(self._of_run()[0].notes)

    @property
    def cautions(self) -> tuple[str, ...]:
        """Those of `messages` that something may be wrong: `warnings`, contradictions
        that the rows do not confirm, and warnings of the reader of the log."""
        _, ready = self._of_run()
        return (*ready.warnings, *ready.doubts, *ready.log.warnings)

    @property
    def rows(self) -> int:
        """Rows that were estimated; `table` may hold fewer."""
        return len(self._estimated())

    @property
    def interrupted(self) -> bool:
        """Whether Ctrl-C ended the run early (`keep_partial`)."""
        return self._estimated().interrupted

    @property
    def calibration_interrupted(self) -> bool:
        """Whether Ctrl-C ended the calibration on the log itself (`keep_partial`)."""
        return self.calibration is not None and self.calibration.get("why") == STOPPED

    @property
    def reported(self) -> bool:
        """Whether the page of the argument `report` was written: a run without a row has
        none."""
        return self._ran is not None and self._ran[0].reported

    @property
    def started_from(self) -> str | None:
        """Learnt state that the run started from, and its age."""
        return self._ran[0].started_from if self._ran is not None else None

    def _found(self) -> tuple[list[Finding], list[regimes.Change]]:
        if self._ran is not None:
            return self._ran[0].findings, self._ran[0].changes
        plain = _convert_flags(self.table)
        changes = regimes.find_changes(plain)
        return make_findings(plain, self._config(), changes, self.warnings, self.uncertainty_sd), changes

    def _config(self) -> Config:
        return self._ran[1].config if self._ran is not None else Filter(settings=self.settings)._config

    def _estimated(self) -> Estimates:
        return (
            self._ran[0].estimate if self._ran is not None else Estimates(_convert_flags(self.table), False)
        )

    def _rows(self, log: Path, cautions: Sequence[str]) -> list[dict[str, Any]]:
        return results.make_rows(log, self._estimated(), *self._found(), cautions)

    def filter(self) -> Filter:
        """Return a filter with the settings of this run, before its first row."""
        return Filter(settings=self.settings)

    @property
    def log(self) -> Log:
        """The log as it was estimated."""
        return Log(self._of_run()[1].log)

    def to_frame(self) -> pd.DataFrame:
        """Return `table`: n rows."""
        return self.table

    def to_dict(self) -> dict[str, Any]:
        """Return the document of `tselab estimate --json`."""
        ran, ready = self._of_run()
        itself = None if ready.own is None else {**ready.own.found, "words": ready.vehicle.found}
        said = {
            "vehicle": ready.vehicle.path,
            "started_from": self.started_from,
            "filled": ready.vehicle.filled,
            "calibration": itself,
            "notes": [n for n in self.messages if n not in self.cautions],
            "warnings": self.cautions,
            "interrupted": self.interrupted,
        }
        found: dict[str, Any] = results.convert_to_plain(
            results.make_document(ready.log.path, ran.estimate, ran.findings, ready.config, said)
        )
        return found

    def _shown_rows(self) -> pd.DataFrame:
        return self.stretches

    def plot(self) -> Any:
        """Return a figure of plotly: the stiffnesses with their 95 % interval, grey where
        not valid, and events."""
        ran, ready = self._of_run()
        self._check_whole("plot")
        data = plots.Data(ready.log)
        data.add(ran.estimate.table)
        spells = regimes.find_spells(ran.estimate.table)
        table = ran.estimate.table
        return make_figure(plots.draw_stiffness(data, table, ready.config, ran.changes, spells))

    def report(self, path: str | os.PathLike[str]) -> Path:
        """Write the page of `tselab estimate --report`."""
        from tse.report.report import write_report  # plotly: for those who draw

        ran, ready = self._of_run()
        self._check_whole("report")
        judged = ran.changes, ran.findings
        write_report(
            Path(path), ran.estimate, ready.log, ready.vehicle, ready.config, ran.notes, judged=judged
        )
        return Path(path)

    def _of_run(self) -> tuple[Run, Prepared]:
        if self._ran is None:
            raise ValueError("this result was put together by hand: it has no log")
        return self._ran

    def _check_whole(self, what: str) -> None:
        """Refuse what needs all columns of a table that holds a summary."""
        if not set(list_est_columns()) <= {*self.table}:
            raise ValueError(
                f"{what}: the rows of this run are in the file of `out`; estimate() without it, or with"
                " `report`, holds or draws them"
            )

    def to_csv(self, path: str | os.PathLike[str]) -> None:
        """Write the estimates as `tselab estimate --out` does, byte for byte."""
        self._check_whole("to_csv")
        write_estimates(_convert_flags(self.table), Path(path))

    def write_table(self, path: str | os.PathLike[str]) -> Path:
        """Write the table of the command, .parquet or .csv by the name."""
        _, ready = self._of_run()
        results.write_rows(Path(path), self._rows(ready.log.path, self.cautions), results.COLUMNS)
        return Path(path)

    def save_learnt(self, path: str | os.PathLike[str]) -> Path:
        """Write the learnt state for the next drive. Error: nothing was learnt."""
        if self.learnt is None:
            raise UserError(f"nothing was learnt: {path} is not written")
        write_learnt(Path(path), self.learnt)
        return Path(path)


def estimate(
    log: LogLike,
    vehicle: VehicleLike,
    *,
    settings: Mapping[str, float] | None = None,
    form: Form = "default",
    average: float | None = None,
    learnt: bytes | os.PathLike[str] | None = None,
    age: float = UNKNOWN_AGE,
    calibrate: bool = True,
    road: PathLike | Road | None = None,
    config: PathLike | None = None,
    reading: Reading | None = None,
    out: PathLike | None = None,
    report: PathLike | None = None,
    keep_partial: bool = False,
    progress: Callable[[str], None] | None = None,
    bar: bool = False,
) -> Result:
    """Estimate tyre stiffness from a log.

        result = tse.estimate("log.csv", "car.toml")
        result.plot()
        result.stiffness[-1], result.valid[-1], result.words

    Parameters
    ----------
    log
        A file of any format, a data frame, arrays by their names, or a structured array:
        columns time [s], steer_angle [rad, of the road wheels], wheel_speed_front,
        wheel_speed_rear [rad/s, or both wheels of an axle: wheel_speed_front_left,
        _right], accel_x, accel_y [m/s2], yaw_rate [rad/s], n values each. NaN is missing.
        Other columns are ignored. ISO 8855, left is positive. Rows are 1 ms .. 1 s apart,
        also irregularly. time may be dates or time spans, and be the index. Tables of
        pyarrow and frames of polars are taken, too.
    vehicle
        A vehicle file, a mapping with its keys, or what read_vehicle() returned.
    settings
        Any settings by name; they win over `config` and the vehicle.
    form
        "default", or the paper's filter with particles: "robust", "paper" as printed.
    average
        s: average the log over blocks of this length first, at most 0.1; for noisy
        sensors.
    learnt
        Learnt state of an earlier drive of this vehicle (Result.learnt,
        Filter.save_learnt()), or the Path of a file with it.
    age
        s since that drive. Default: unknown, or the age of the file.
    calibrate
        Calibrate a car that nobody has calibrated on the log itself first
        (Result.calibration); not with `learnt`.
    road
        road.csv: the filter is given its bank and grade. The log is placed on it by
        position, else by its path.
    config
        A file of settings, FILTER.toml.
    reading
        How a file is read: signals, rate, strict, databases.
    out
        Write the estimates there while the filter runs, .csv or .parquet by the name.
        Memory then holds a summary (Result.table).
    report
        Write the page of `tselab estimate --report` there, with the run.
    keep_partial
        On Ctrl-C return what is done (Result.interrupted) in place of raising
        KeyboardInterrupt.
    progress
        Called with a sentence about the current step of the calibration.
    bar
        Show a progress bar on standard error.

    Returns
    -------
    Result
        The same bits as `tselab estimate` on the same numbers, and as `result.filter()`
        row by row. The validity of a log whose channels contradict each other differs: a
        single row does not show it.

    Raises
    ------
    Error
        A log without steering angle, without both axles' wheel speeds or without accel_y
        and yaw_rate; a column that is not numeric, or often out of range; a ValueError.
        The message names column, row, value and range.
    TypeError
        `log` is not a log.

    Notes
    -----
    Noise and biases of the sensors that the vehicle leaves out are found in
    the log. The run works around missing channels, impossible single values and a clock
    that jumps, and Result.notes names them. If channels contradict each other, a
    UserWarning names them (Result.warnings) and nothing is usable.
    """
    check_form(form)
    car = read_vehicle(vehicle)
    before = read_learnt_state(learnt, age)
    say = progress if progress is not None else lambda _: None
    ready = assemble_run(
        car,
        read_checked(log, car, reading=reading),
        None if config is None else Path(config),
        average,
        {},
        form,
        check_names(settings),
        "settings",
        strict=reading is not None and reading.strict,
        calibrate=Calibrate(say, goes_on=keep_partial) if calibrate and before is None else None,
        road=read_known_road(road),
    )
    ran = run_prepared(
        ready,
        None if out is None else Path(out),
        None if report is None else Path(report),
        before,
        bar,
        whole=out is None,
    )
    done = ran.estimate
    if done.interrupted and not keep_partial:
        raise KeyboardInterrupt
    for line in ready.warnings:
        warnings.warn(line, stacklevel=2)
    flags = [c for c in map(str, done.table) if c.endswith(("_valid", "_spread_seen"))]
    return Result(
        done.table.astype(dict.fromkeys(flags, bool)),
        ready.config.as_dict(),
        (*ready.vehicle.found, *ready.vehicle.filled, *(n for n in ran.notes if n not in ready.warnings)),
        tuple(ready.warnings),
        None if ready.warnings else done.learnt,
        done.uncertainty_sd,
        ready.own.found if ready.own else None,
        ready.vehicle,
        (ran, ready),
    )


def read_learnt_state(learnt: bytes | os.PathLike[str] | None, age: float) -> Learnt | None:
    """Return a learnt state, of a file or in memory. `age`: s; UNKNOWN_AGE of a file:
    that of the file."""
    if isinstance(learnt, os.PathLike):
        return read_learnt(Path(learnt), None if age == UNKNOWN_AGE else age)
    return None if learnt is None else Learnt(Path("learnt"), learnt, age, True)


def _convert_flags(table: pd.DataFrame) -> pd.DataFrame:
    """Return the table as in EST.csv: flags are 0 and 1."""
    return table.astype({c: "int64" for c, kind in table.dtypes.items() if kind.kind == "b"})
