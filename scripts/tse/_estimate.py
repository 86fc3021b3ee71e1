"""A whole log at once."""

from __future__ import annotations

import os
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np
import numpy.typing as npt
import pandas as pd

from tse._base import Array
from tse._filter import UNKNOWN_AGE, Filter, Form, check_form
from tse._log import Log, LogLike, PathLike, checked, known_road
from tse._shown import Shown, drawn
from tse._tables import STIFFNESS
from tse._vehicle import VehicleLike, named, read_vehicle
from tse.car.vehicle import Vehicle
from tse.estimation import regimes
from tse.estimation.answer import answer
from tse.estimation.estimate import Estimate as Estimated
from tse.estimation.estimate import Learnt, write_estimates
from tse.estimation.estimate import estimate as _run
from tse.estimation.verdict import Finding, contradictions, findings, late_steering
from tse.report import plots, results
from tse.roads.road import Road
from tse.runs.single import Calibrate, Prepared, assemble, contradicts, notes_of

Usable: TypeAlias = Literal["yes", "in part", "no"]
USABLE: dict[int, Usable] = {results.USABLE: "yes", results.IN_PART: "in part", results.NOTHING: "no"}


@dataclass(frozen=True, repr=False)
class Result(Shown):
    """Estimates of n rows, and what the run was."""

    table: pd.DataFrame
    """n rows with the columns of `tselab estimate` (its --help lists units): time, vel_x, cy_front, cy_front_sd, p_changed ...; the
    columns _valid and _spread_seen are booleans, _reason are words."""
    settings: dict[str, float | int]
    """All settings of the run, by name: also those that were found in the log."""
    notes: tuple[str, ...] = ()
    """What was odd, or was filled in, in words."""
    warnings: tuple[str, ...] = ()
    """In what the channels contradict each other (units, signs, axes), in words. Of such a log no stiffness is usable and no row
    valid: the filter takes a channel that is wrong all the time for another car, so what it calls valid is implausible here."""
    learnt: bytes | None = None
    """What the log has taught, for the next drive: for the argument `learnt`, Filter.load_learnt() and tse_learnt_load() in C.
    None: no row was used, or the channels contradict each other."""
    uncertainty_sd: dict[str, npt.NDArray[np.float64]] = field(default_factory=dict)
    """Share of the final sd that each uncertain parameter of the car adds: (3,), relative to nominal."""
    calibration: dict[str, Any] | None = None
    """What the calibration on the log itself has found: used (else why not), seconds, stiffness with its 95 % interval [N/rad],
    latency [s], not_shown. None: the car was calibrated, or nobody asked."""
    vehicle: Vehicle | None = None
    """The car as it was taken, of which `learnt` is: estimate(next, result.vehicle, learnt=result.learnt)."""
    _ran: tuple[Estimated, Prepared] | None = field(default=None, repr=False, compare=False)

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
        """(n, 3) stiffness in effect, in the same units: force over slip at the slip and load of each row; as uncertain, in
        proportion, as `stiffness`."""
        return self._three("_secant")

    @property
    def stiffness_spread(self) -> Array:
        """(n, 3) standard deviations of the stiffness from sample to sample, in the same units; of the default form: how large the
        model discrepancy is, as a stiffness."""
        return self._three("_spread")

    @property
    def valid(self) -> npt.NDArray[np.bool_]:
        """(n, 3) True where the stiffness may be used."""
        return self.table[[f"{s}_valid" for s in STIFFNESS]].to_numpy(bool)

    @property
    def reason(self) -> npt.NDArray[np.object_]:
        """(n, 3) "valid", or why the stiffness is not."""
        return np.column_stack([self.table[f"{s}_reason"].astype(str).to_numpy(object) for s in STIFFNESS])

    @property
    def status(self) -> npt.NDArray[np.int64]:
        """(n,) codes of tse.Status; below 0: the row was refused."""
        return self.table["status"].to_numpy(np.int64)

    @property
    def words(self) -> tuple[str, ...]:
        """What the log says of the tyres, as `tselab estimate` ends. Of a car that nobody has calibrated, the first line says
        what the calibration on the log itself has found, or that there was none: C, FMU, page and Filter have none."""
        itself = self.vehicle.found[:1] if self.vehicle is not None else []
        return (*itself, *(line for f in self._found()[0] for line in f.lines()))

    @property
    def answer(self) -> tuple[str, ...]:
        """Three lines: each stiffness with its 95 % interval, and whether to act on it; of a road
        that changed three for each of the last stretches. `repr()` says the same."""
        return tuple(answer(self._found()[0], Filter(settings=self.settings)._config))

    def __repr__(self) -> str:
        return "\n".join(self.answer)

    @property
    def usable(self) -> Usable:
        """ "yes": the log tells every stiffness; "in part"; "no": none. The exit code of `tselab estimate` says the same."""
        return USABLE[results.exit_code(self._found()[0])]

    @property
    def stretches(self) -> pd.DataFrame:
        """What is known, as `tselab estimate --table` writes it: a row per stretch of road between changes and stiffness, with
        start, end [s], value at the end of the stretch with its sd and 95 % interval low .. high [N, N/rad], also where no row is
        valid; smoothed over the stretch with smoothed_sd, smoothed_low .. smoothed_high and smoothed_reason ("valid", or why not to
        act on it); valid (share of the rows), usable, reason, change, change_probability, ratio, text."""
        found, changes = self._found()
        rows = results.rows(Path(), Estimated(_plain(self.table), False), found, changes, self.warnings)
        return results.as_frame(rows, results.COLUMNS).drop(columns="log")

    def _found(self) -> tuple[list[Finding], list[regimes.Change]]:
        plain, config = _plain(self.table), Filter(settings=self.settings)._config
        changes = regimes.changes(plain)
        return findings(plain, config, changes, self.warnings, self.uncertainty_sd), changes

    def filter(self) -> Filter:
        """A filter with the settings of this run, before its first row."""
        return Filter(settings=self.settings)

    @property
    def log(self) -> Log:
        """The log as it was estimated."""
        return Log(self._of_run()[1].log)

    def to_frame(self) -> pd.DataFrame:
        """Return `table`: n rows."""
        return self.table

    def _shown_rows(self) -> pd.DataFrame:
        return self.stretches

    def plot(self) -> Any:
        """Return a figure of plotly: the stiffnesses with their 95 % interval, grey where not valid, and what happened."""
        done, ready = self._of_run()
        data = plots.Data(ready.log)
        data.add(done.table)
        changes, spells = regimes.changes(done.table), regimes.spells(done.table)
        return drawn(plots.stiffness_figure(data, done.table, ready.config, changes, spells))

    def report(self, path: str | os.PathLike[str]) -> Path:
        """Write the page of `tselab estimate --report`."""
        from tse.report.report import write_report  # plotly: for those who draw

        done, ready = self._of_run()
        write_report(
            Path(path),
            done,
            ready.log,
            ready.vehicle,
            ready.config,
            notes_of(ready, done),
            None,
            self.warnings,
        )
        return Path(path)

    def _of_run(self) -> tuple[Estimated, Prepared]:
        if self._ran is None:
            raise ValueError("this result was put together by hand: it has no log")
        return self._ran

    def to_csv(self, path: str | os.PathLike[str]) -> None:
        """Write what `tselab estimate` writes, byte for byte."""
        write_estimates(_plain(self.table), Path(path))


def estimate(
    log: LogLike,
    vehicle: VehicleLike,
    *,
    settings: Mapping[str, float] | None = None,
    form: Form = "default",
    average: float | None = None,
    learnt: bytes | None = None,
    age: float = UNKNOWN_AGE,
    calibrate: bool = True,
    road: PathLike | Road | None = None,
) -> Result:
    """Estimate tyre stiffness from a log.

        result = tse.estimate("log.csv", "car.toml")
        result.plot()
        result.stiffness[-1], result.valid[-1], result.words

    Parameters
    ----------
    log
        A file of any format (read_log() reads one with options), a data frame, arrays by their names, or a structured array:
        columns time [s], steer_angle [rad, of the road wheels], wheel_speed_front, wheel_speed_rear [rad/s, or both wheels of an
        axle: wheel_speed_front_left, _right], accel_x, accel_y [m/s2], yaw_rate [rad/s], n values each; NaN is missing; other
        columns are passed over. ISO 8855, left is positive; 1 ms .. 1 s from row to row, also irregularly. time may be dates or
        spans of time, and be the index; a table of pyarrow and a frame of polars are taken, too.
    vehicle
        A vehicle file, a mapping with its keys, or what read_vehicle() returned.
    settings
        Any settings by name; they win.
    form
        "default", or the paper's filter with particles: "robust", "paper" as printed.
    average
        s: means of blocks of so long first, at most 0.1; for noisy sensors.
    learnt
        What an earlier drive has taught (Result.learnt, Filter.save_learnt()), of this vehicle.
    age
        s since that drive.
    calibrate
        A car that nobody has calibrated on the log itself first (Result.calibration); not with `learnt`.
    road
        road.csv: the filter is given its bank and grade, where the log is on it by position or by path.

    Returns
    -------
    Result
        The same bits as `tselab estimate` on the same numbers, and as `result.filter()` row by row, but for the validity of a
        log whose channels contradict each other, of which a row alone does not know.

    Raises
    ------
    Error
        A log without steering angle, without both axles' wheel speeds or without accel_y and yaw_rate; a column that is not
        numeric, or often out of range; a ValueError. The message names column, row, value and range.
    TypeError
        What is no log.

    Notes
    -----
    What the vehicle leaves out of the sensors is found in the log. A channel that is not there, single values that nothing can
    have, and a clock that jumps are worked around, and Result.notes says so; channels that contradict each other are warned of
    (Result.warnings, UserWarning), and leave nothing usable.
    """
    check_form(form)
    itself = Calibrate() if calibrate and learnt is None else None
    car = read_vehicle(vehicle)
    ready = assemble(
        car,
        checked(log, car),
        None,
        average,
        {},
        form,
        named(settings),
        "settings",
        calibrate=itself,
        road=known_road(road),
    )
    before = None if learnt is None else Learnt(Path("learnt"), learnt, age, True)
    done = _run(ready.log, ready.config, learnt=before, contradicted=bool(ready.warnings))
    if not done.interrupted and contradicts(ready, done.table):
        done = _run(ready.log, ready.config, learnt=before, contradicted=True)
    if done.interrupted:
        raise KeyboardInterrupt
    for line in ready.warnings:
        warnings.warn(line, stacklevel=2)
    flags = [c for c in map(str, done.table) if c.endswith(("_valid", "_spread_seen"))]
    return Result(
        done.table.astype(dict.fromkeys(flags, bool)),
        ready.config.as_dict(),
        (
            *ready.vehicle.found,
            *ready.vehicle.filled,
            *(n for n in ready.notes if n not in ready.warnings),
            *(contradictions(done.table) if not ready.warnings else []),
            *(late_steering(done.table, ready.config) if not ready.warnings else []),
        ),
        tuple(ready.warnings),
        None if ready.warnings else done.learnt,
        done.uncertainty_sd,
        ready.own.found if ready.own else None,
        ready.vehicle,
        (done, ready),
    )


def _plain(table: pd.DataFrame) -> pd.DataFrame:
    """As in EST.csv: flags are 0 and 1."""
    return table.astype({c: "int64" for c, kind in table.dtypes.items() if kind.kind == "b"})
