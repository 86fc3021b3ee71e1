"""Estimate the tyre stiffness of a whole log: estimate() and its result."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd

from tse.api.base import Array
from tse.api.filter import UNKNOWN_AGE, Filter, Form, check_form
from tse.api.generated import STIFFNESS
from tse.api.log import Log, LogLike, PathLike, read_checked, read_known_road
from tse.api.shown import Shown, make_figure
from tse.api.vehicle import VehicleLike, check_names, read_vehicle
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


@dataclass(frozen=True, repr=False)
class Result(Shown):
    """Result of estimate(): the estimates of all rows, and the conclusions from them.

    n is the number of rows of `table`."""

    table: pd.DataFrame
    """(n rows) The columns of `tselab estimate` (its --help lists units): time, vel_x,
    cy_front, cy_front_sd, p_changed ... Columns _valid and _spread_seen are booleans,
    columns _reason are strings. If estimate() was called with `out`, the table has only
    the columns that `words` needs, and at most 524288 rows (87 minutes at 100 Hz): of a
    longer log, every k-th row, with the smallest k that is sufficient."""
    settings: dict[str, float | int]
    """All settings of the run by name, also those that were estimated from the log."""
    notes: tuple[str, ...] = ()
    """Sentences about what was unusual in the log, and which values were filled in."""
    warnings: tuple[str, ...] = ()
    """Sentences about channels that contradict each other (units, signs, axes). The
    filter cannot distinguish a permanently wrong channel from a different car, so no row
    of such a log is valid and no stiffness is usable."""
    learnt: bytes | None = None
    """State that the filter has learnt, from which the next drive can start: pass it as
    the argument `learnt`, to Filter.load_learnt(), or to tse_learnt_load() in C. None: no
    row was used, or the channels contradict each other."""
    uncertainty_sd: dict[str, npt.NDArray[np.float64]] = field(default_factory=dict)
    """Key: uncertain parameter of the car (mass_sd ...). Value: (3,) the part of the
    final sd of the three stiffnesses that this parameter causes, relative to nominal."""
    calibration: dict[str, Any] | None = None
    """Result of the calibration of the car on this log. Keys: used, whether the estimates
    use the calibration; why, the reason if they do not; seconds, how much of the log was
    compared with the simulation; stiffness, with 95 % intervals [N/rad]; latency [s];
    not_shown, the parameters that the log does not determine. None: the car was
    calibrated before, or `calibrate` was False."""
    vehicle: Vehicle | None = None
    """The car that was used. `learnt` belongs to it: call estimate(next_log,
    result.vehicle, learnt=result.learnt)."""
    _ran: tuple[Run, Prepared] | None = field(default=None, repr=False, compare=False)

    def __len__(self) -> int:
        return len(self.table)

    @property
    def time(self) -> Array:
        """(n,) [s] time of each row, as in the log."""
        return self.table["time"].to_numpy(float)

    def _select_three(self, end: str) -> Array:
        return self.table[[f"{s}{end}" for s in STIFFNESS]].to_numpy(float)

    @property
    def stiffness(self) -> Array:
        """(n, 3) mean stiffnesses: cx_front [N], cy_front and cy_rear [N/rad]."""
        return self._select_three("")

    @property
    def stiffness_sd(self) -> Array:
        """(n, 3) standard deviations of `stiffness`, in the same units."""
        return self._select_three("_sd")

    @property
    def stiffness_secant(self) -> Array:
        """(n, 3) secant stiffness: tyre force divided by slip, at the slip and
        load of each row, in the units of `stiffness`. Its relative sd is the
        same as that of `stiffness`."""
        return self._select_three("_secant")

    @property
    def stiffness_spread(self) -> Array:
        """(n, 3) spread, in the units of `stiffness`. Its meaning depends on the argument
        `form` of estimate(). For the particle filters "robust" and "paper", the spread is
        the standard deviation with which the stiffness varies from sample to sample. For
        "default", it is the sd of the model error: the setting model_sd, which is
        relative, times the stiffness."""
        return self._select_three("_spread")

    @property
    def valid(self) -> npt.NDArray[np.bool_]:
        """(n, 3) whether each stiffness may be used."""
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
        """The result in sentences, as the last lines of `tselab estimate --verbose`.

        If the car is not calibrated, estimate() first calibrates it on this log. In this
        case, the first sentence gives the stiffness from the calibration, or the reason
        why the car stays uncalibrated. Filter, the C library, the FMU and the browser
        page never calibrate a car, so their estimates may differ from those of
        estimate()."""
        itself = self.vehicle.found[:1] if self.vehicle is not None else []
        return (*itself, *(line for lines in self.stretch_words for line in lines))

    @property
    def stretch_words(self) -> tuple[tuple[str, ...], ...]:
        """For each stretch of road between two changes, a tuple of sentences about it."""
        return tuple(tuple(f.lines()) for f in self._get_findings()[0])

    @property
    def answer(self) -> tuple[str, ...]:
        """Three lines: each stiffness with its 95 % interval, and whether it is usable.
        If the road changed, the log is divided into stretches at the changes, and there
        are three lines for each of the last two stretches. `repr()` returns the lines as
        one string."""
        return tuple(make_answer(self._get_findings()[0], self._make_config()))

    def __repr__(self) -> str:
        return "\n".join(self.answer)

    @property
    def usable(self) -> results.Usable:
        """ "yes": every stiffness is usable; "in part": only some are; "no": none is. It
        has the same meaning as `exit_code`."""
        return results.CODES[self.exit_code]

    @property
    def exit_code(self) -> int:
        """Exit code of `tselab estimate`: 0 usable, 3 usable in part, 4 nothing
        usable."""
        return results.choose_exit_code(self._get_findings()[0])

    @property
    def stretches(self) -> pd.DataFrame:
        """Table of `tselab estimate --table`: a row for each stiffness on each stretch of
        road between two changes.

        Columns: start, end [s]; value (estimate at the end of the stretch, given even if
        no row is valid), sd, low, high (95 % interval) [N or N/rad]; smoothed (estimate
        smoothed over the stretch), smoothed_sd, smoothed_low, smoothed_high;
        smoothed_reason ("valid", or why `smoothed` should not be used); valid (share of
        valid rows), usable, reason, change (kind of the change of road or tyres at the
        start of the stretch), change_probability, ratio (stiffness after / before this
        change), text (a sentence)."""
        return results.make_frame(self._make_rows(Path(), self.warnings), results.ESTIMATE_COLUMNS).drop(
            columns="log"
        )

    @property
    def events(self) -> tuple[str, ...]:
        """A sentence for each event of the drive: change of the
        road, sensor fault, sliding."""
        table = self._get_estimates().table
        return tuple(regimes.describe_events(self._get_findings()[1], regimes.find_spells(table)))

    @property
    def facts(self) -> tuple[tuple[str, str], ...]:
        """Facts about log, vehicle and filter of the run, as pairs of name and value."""
        ran, ready = self._get_run()
        return tuple(results.list_run_facts(ran.estimate, ready.log, ready.vehicle, ready.config))

    @property
    def messages(self) -> tuple[str, ...]:
        """`warnings` and `notes` in the order in which `tselab estimate` prints them,
        without two kinds of `notes`: on the calibration of the car on this log, and on
        the values that replace missing keys of the vehicle file."""
        return tuple(self._get_run()[0].notes)

    @property
    def cautions(self) -> tuple[str, ...]:
        """Sentences about what may be wrong: first `warnings`, then possible
        contradictions, then problems found while the log was read.

        A possible contradiction is one between channels, or between the vehicle file and
        the calibration on this log. It is one of the `warnings` instead if the estimates
        show that channels contradict each other."""
        _, ready = self._get_run()
        return (*ready.warnings, *ready.doubts, *ready.log.warnings)

    @property
    def rows(self) -> int:
        """Number of rows that were estimated. `table` has fewer rows if estimate() was
        called with `out` and the log is very long."""
        return len(self._get_estimates())

    @property
    def interrupted(self) -> bool:
        """Whether Ctrl-C ended the run early. Always False if estimate() was called
        without `keep_partial`, because Ctrl-C then raises KeyboardInterrupt."""
        return self._get_estimates().interrupted

    @property
    def calibration_interrupted(self) -> bool:
        """Whether Ctrl-C ended the calibration of the car on this log. Always False if
        estimate() was called without `keep_partial`, because Ctrl-C then raises
        KeyboardInterrupt."""
        return self.calibration is not None and self.calibration.get("why") == STOPPED

    @property
    def reported(self) -> bool:
        """Whether the HTML page was written to the file that was given to estimate() as
        `report`. The page is not written if no row was estimated."""
        return self._ran is not None and self._ran[0].reported

    @property
    def started_from(self) -> str | None:
        """Sentence about the learnt state from which the run started, with the age of
        this state. None: the run did not start from a learnt state."""
        return self._ran[0].started_from if self._ran is not None else None

    def _get_findings(self) -> tuple[list[Finding], list[regimes.Change]]:
        if self._ran is not None:
            return self._ran[0].findings, self._ran[0].changes
        plain = _convert_flags(self.table)
        changes = regimes.find_changes(plain)
        return make_findings(plain, self._make_config(), changes, self.warnings, self.uncertainty_sd), changes

    def _make_config(self) -> Config:
        return self._ran[1].config if self._ran is not None else Filter(settings=self.settings)._config

    def _get_estimates(self) -> Estimates:
        return (
            self._ran[0].estimate if self._ran is not None else Estimates(_convert_flags(self.table), False)
        )

    def _make_rows(self, log: Path, cautions: Sequence[str]) -> list[dict[str, Any]]:
        return results.make_rows(log, self._get_estimates(), *self._get_findings(), cautions)

    def filter(self) -> Filter:
        """Return a filter with the settings of this run, before its first row."""
        return Filter(settings=self.settings)

    @property
    def log(self) -> Log:
        """The log with the rows that the filter received. If estimate() was called with
        `average`, they are the averaged rows."""
        return Log(self._get_run()[1].log)

    def to_frame(self) -> pd.DataFrame:
        """Return `table`."""
        return self.table

    def to_dict(self) -> dict[str, Any]:
        """Return what `tselab estimate --json` prints, as a dict."""
        ran, ready = self._get_run()
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
        """Return a plotly figure of the stiffnesses with their 95 % intervals and of the
        events of the drive. A stiffness is grey where it is not valid."""
        ran, ready = self._get_run()
        self._check_whole("plot")
        data = plots.Data(ready.log)
        data.add(ran.estimate.table)
        spells = regimes.find_spells(ran.estimate.table)
        table = ran.estimate.table
        return make_figure(plots.draw_stiffness(data, table, ready.config, ran.changes, spells))

    def report(self, path: str | os.PathLike[str]) -> Path:
        """Write the page of `tselab estimate --report`."""
        from tse.report.report import write_report  # imports plotly, which is slow

        ran, ready = self._get_run()
        self._check_whole("report")
        judged = ran.changes, ran.findings
        write_report(
            Path(path), ran.estimate, ready.log, ready.vehicle, ready.config, ran.notes, judged=judged
        )
        return Path(path)

    def _get_run(self) -> tuple[Run, Prepared]:
        if self._ran is None:
            raise ValueError("this Result was not made by estimate(), so it has no log")
        return self._ran

    def _check_whole(self, what: str) -> None:
        """Raise ValueError if `table` is only a summary. `what`: name of the method that
        needs all rows and columns, for the message."""
        if not set(list_est_columns()) <= {*self.table}:
            raise ValueError(
                f"{what}: this result holds only a summary, because `out` wrote the rows to a file. Call "
                "estimate() without `out`. To get the HTML page, call estimate() with `report`"
            )

    def to_csv(self, path: str | os.PathLike[str]) -> None:
        """Write the estimates as `tselab estimate --out` does, byte for byte."""
        self._check_whole("to_csv")
        write_estimates(_convert_flags(self.table), Path(path))

    def write_table(self, path: str | os.PathLike[str]) -> Path:
        """Write the table of `tselab estimate --table`: Parquet if `path` ends in
        .parquet, otherwise CSV."""
        _, ready = self._get_run()
        results.write_rows(
            Path(path), self._make_rows(ready.log.path, self.cautions), results.ESTIMATE_COLUMNS
        )
        return Path(path)

    def save_learnt(self, path: str | os.PathLike[str]) -> Path:
        """Write the learnt state to a file, for the next drive. Raise
        Error if nothing was learnt."""
        if self.learnt is None:
            raise UserError(
                f"nothing was learnt, so {path} is not written: no row was used, or channels contradict "
                "each other"
            )
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
        A file of any format, a data frame, a mapping of names to arrays, or a structured
        array. Its columns are time [s], steer_angle [rad at the road wheels],
        wheel_speed_front, wheel_speed_rear [rad/s], accel_x, accel_y [m/s2] and yaw_rate
        [rad/s]. Two columns wheel_speed_front_left and _right may replace the speed of an
        axle. Other columns are ignored. NaN is a missing value. Axes are those of ISO
        8855, left is positive. Rows are 1 ms .. 1 s apart, not necessarily equally. time
        may hold dates or time spans, and may be the index. Tables of pyarrow and frames
        of polars are accepted, too.
    vehicle
        A vehicle file, a mapping with its keys, or the result of read_vehicle().
    settings
        Any settings by name. They override `config` and the vehicle.
    form
        Which filter runs. "default": the Kalman filter of tse. "paper": the particle
        filter as printed in the paper of Berntorp and Di Cairano (2016). "robust": the
        particle filter with settings that keep it from diverging.
    average
        [s] Length of the blocks over which the log is averaged before the filter runs, at
        most 0.1. Averaging is meant for noisy sensors. None: no averaging.
    learnt
        Learnt state of an earlier drive of this vehicle (Result.learnt or
        Filter.save_learnt()), or the Path of a file with it. None: the filter
        starts from the settings.
    age
        [s] Time since the drive on which `learnt` was learnt. By default, it is the age
        of the file if `learnt` is a Path, and unknown if `learnt` is bytes.
    calibrate
        True: a car without calibrated stiffness is first calibrated on this log, unless
        `learnt` is given. Result.calibration is the result. False: no calibration.
    road
        Bank and grade of the road, for the filter: a file road.csv or a Road. The
        position of the car on the road is found from the positions in the log or, without
        them, from the driven path.
    config
        A TOML file with settings, `name = value`, that override the vehicle. None: no
        such file.
    reading
        How a file is read: Reading(signals=, rate=, strict=, databases=), the options of
        read_log(). None: their defaults.
    out
        File to which the estimates are written while the filter runs: Parquet if it ends
        in .parquet, otherwise CSV. Result.table then is a summary, which saves memory.
    report
        File for the HTML page that `tselab estimate --report` writes. Its plots are
        prepared during the run.
    keep_partial
        If True, the call returns the rows done so far after Ctrl-C (Result.interrupted).
        If False, it raises KeyboardInterrupt.
    progress
        Called with a sentence about the current step of the calibration.
    bar
        Show a progress bar on standard error.

    Returns
    -------
    Result
        `tselab estimate` computes the same estimates bit by bit. `result.filter()` also
        computes them if it is given the same rows, with one exception. If channels of the
        whole log contradict each other (for instance by a wrong sign or unit), estimate()
        marks all rows as not valid. A filter cannot do this, because it gets single rows,
        in which such a contradiction is not visible.

    Raises
    ------
    Error
        The log has no steering angle, no wheel speed, or neither accel_y nor yaw_rate; or
        a column is not numeric, or is often out of range. The message names column, row,
        value and range. The error is also a ValueError.
    TypeError
        `log` is of a type that cannot be a log.

    Notes
    -----
    If the vehicle does not state noise and biases of the sensors, they are estimated from
    the log. Missing channels, impossible single values and a clock that jumps do not end
    the run; Result.notes names them. If channels contradict each other, a UserWarning
    names these channels (so does Result.warnings), and no stiffness is usable.
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
    """Return a learnt state that is given as bytes or as a file; None without one.

    `age`: [s] time since the state was learnt. If `age` is UNKNOWN_AGE and `learnt` is a
    file, the age of the file is used."""
    if isinstance(learnt, os.PathLike):
        return read_learnt(Path(learnt), None if age == UNKNOWN_AGE else age)
    return None if learnt is None else Learnt(Path("learnt"), learnt, age, True)


def _convert_flags(table: pd.DataFrame) -> pd.DataFrame:
    """Return the table with 0 and 1 in its boolean columns, as in the CSV of to_csv()."""
    return table.astype({c: "int64" for c, kind in table.dtypes.items() if kind.kind == "b"})
