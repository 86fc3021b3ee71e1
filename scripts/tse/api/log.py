"""Read logs of many formats, and propose for each channel (input of the filter) the
signal of a log that contains it: read_log(), signals() and their results."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any, TypeAlias, cast

import numpy as np
import numpy.typing as npt
import pandas as pd

from tse.api.base import Array
from tse.api.shown import Shown, make_figure
from tse.api.vehicle import VehicleLike, read_vehicle
from tse.car.vehicle import Vehicle
from tse.channels.log import adapt_to_car, read_frame
from tse.channels.log import read_log as _read_log
from tse.channels.proposal import Line, Proposal, format_headline, format_signals, list_signals, propose
from tse.channels.signals import find_signals
from tse.library.errors import UserError
from tse.library.files import write_atomically
from tse.log.rows import CheckedLog as Checked
from tse.log.rows import Reading
from tse.readers.readers import read_recording
from tse.readers.recording import ReadOptions, Recording
from tse.report import plots
from tse.report.results import convert_to_plain
from tse.roads.road import Road, read_road

PathLike: TypeAlias = "str | os.PathLike[str]"
LogLike: TypeAlias = "PathLike | Log | Mapping[str, Any] | pd.DataFrame | npt.NDArray[np.void]"


class Log(Shown):
    """Result of read_log(): the checked rows of a log, in SI units and in the axes of ISO
    8855."""

    def __init__(self, checked: Checked):
        self._checked = checked
        self.path = checked.path
        """File of the log."""
        self.notes = tuple(checked.notes)
        """Sentences about what was unusual in the log, and
        which values were filled in."""
        self.warnings = tuple(checked.warnings)
        """The `notes` about what may be wrong."""

    def __len__(self) -> int:
        return len(self._checked)

    @property
    def time(self) -> Array:
        """[s] Time of each row, on the clock of the log."""
        return np.asarray(self._checked.time, float)

    @property
    def sample_time(self) -> float | None:
        """[s] Median time between rows. None: the log has a single row."""
        return self._checked.sample_time

    @property
    def words(self) -> tuple[str, ...]:
        """Sentences: number of rows and duration, then the notes."""
        span = float(self.time[-1] - self.time[0]) if len(self) else 0.0
        return (f"{self.path.name}: {len(self)} rows, {span:.1f} s", *self.notes)

    def to_frame(self) -> pd.DataFrame:
        """Return the rows as a data frame for estimate(): time, channels, optional
        channels, and the columns ref_... (reference values)."""
        parts = (self._checked.data, self._checked.extra, self._checked.ref)
        return pd.concat(
            [pd.Series(self.time, name="time"), *(p.reset_index(drop=True) for p in parts)], axis=1
        )

    def plot(self) -> Any:
        """Return a plotly figure: the channels over time."""
        data = plots.Data(self._checked)
        data.rows = len(self)
        return make_figure(plots.draw_inputs(data))


def read_log(
    path: PathLike,
    vehicle: VehicleLike | None = None,
    *,
    signals: PathLike | None = None,
    rate: float | None = None,
    strict: bool = False,
    databases: Sequence[PathLike] = (),
) -> Log:
    """Read a log of any format that `tselab signals --help` lists.

    Parameters
    ----------
    path
        The file: CSV, Parquet, MF4, BLF, MCAP, ROS bag, MAT, openpilot ...
    vehicle
        As in estimate(). Its wheel radii convert wheel speeds in m/s to
        rad/s, and its steering ratio converts the angle of the steering wheel
        to that of the road wheels.
    signals
        The file that assigns signals of the log to channels (inputs of the filter). None:
        the file signals.toml next to the log is used. If there is no such file, the
        signal of each channel is proposed as by signals().
    rate
        [Hz] Rate of the rows. None: the rate in `signals` or, if it has none, the rate of
        the log.
    strict
        True: problems that normally give a warning raise an Error.
    databases
        Databases of the CAN bus, such as DBC files.

    Returns
    -------
    Log
        The log, to be used in estimate(), calibrate(), gap() and replay().

    Raises
    ------
    FileNotFoundError
        The file does not exist.
    Error
        The file is damaged, or lacks a required channel. The message names file, line and
        column. The error is also a ValueError.
    """
    car = None if vehicle is None else read_vehicle(vehicle)
    file = Path(signals) if signals is not None else None
    return Log(_read_log(Path(path), reading=Reading(file, rate, strict, tuple(map(Path, databases)), car)))


def read_checked(log: LogLike, car: Vehicle, name: str = "log", reading: Reading | None = None) -> Checked:
    """Read and check a log of any type. Raise TypeError if `log` is of an unknown type.

    `name`: name by which messages refer to a log in memory."""
    if isinstance(log, str | os.PathLike):
        return _read_log(Path(log), reading=replace(reading or Reading(), car=car))
    return adapt_to_car(log._checked if isinstance(log, Log) else read_frame(_read_columns(log), name), car)


def read_known_road(road: PathLike | Road | None) -> Road | None:
    """Return the road. If `road` is a file, read it; if it is None, return None."""
    return road if road is None or isinstance(road, Road) else read_road(Path(road))


def collect_logs(logs: LogLike | Sequence[LogLike], car: Vehicle, min_logs: int = 1) -> list[Path | Checked]:
    """Return a list of logs: files as paths, logs in memory read and checked. Raise
    UserError if there are fewer than `min_logs`."""
    given = list(logs) if isinstance(logs, list | tuple) else [cast("LogLike", logs)]
    if len(given) < min_logs:
        raise UserError("no log is given")
    return [
        Path(log)
        if isinstance(log, str | os.PathLike)
        else read_checked(log, car, f"log {n}" if len(given) > 1 else "log")
        for n, log in enumerate(given, 1)
    ]


def _read_columns(frame: Any) -> Mapping[str, Any] | pd.DataFrame:
    """Return a log in memory as a mapping from names to columns. Raise TypeError if the
    log has no named columns."""
    if isinstance(frame, np.ndarray) and frame.dtype.names:
        return {name: frame[name] for name in frame.dtype.names}
    if isinstance(frame, pd.DataFrame | Mapping):
        return frame
    if callable(getattr(frame, "to_pandas", None)):  # a table of pyarrow, a frame of polars
        return pd.DataFrame(frame.to_pandas())
    wanted = "give a file, a data frame, a dict of arrays or a structured array"
    if isinstance(frame, np.ndarray):
        raise TypeError(f"the array of the log has no field names; {wanted}")
    if isinstance(frame, list | tuple):
        raise TypeError(
            f"a {type(frame).__name__} cannot be a log; {wanted}; pd.DataFrame() makes a data frame from it"
        )
    raise TypeError(f"{type(frame).__name__} cannot be a log; {wanted}")


# ---- proposal of a signal for each channel


class Signals(Shown):
    """Result of signals(): the proposed signal for each channel of a log."""

    def __init__(self, recording: Recording, proposal: Proposal, how: ReadOptions):
        self._recording, self._proposal, self._how = recording, proposal, how
        self.format = recording.format
        """Name of the format of the log."""
        self.missing = tuple(proposal.missing)
        """Channels for which no signal was found."""
        self.nearest = {c: tuple(x) for c, x in proposal.nearest.items()}
        """For each missing channel the most similar signals, each with the reason why it
        was not proposed."""
        self.warnings = tuple(proposal.warnings)
        """Sentences about what is doubtful in the proposal."""
        self.notes = tuple(recording.notes)
        """Sentences about what was unusual when the log was read."""

    @cached_property
    def _lines(self) -> list[Line]:
        return list_signals(self._recording, self._proposal)

    @property
    def words(self) -> tuple[str, ...]:
        """Sentences: the proposed signal of each channel, then the channels without a
        signal, then the warnings."""
        missing = [f"not found: {', '.join(self.missing)}"] if self.missing else []
        return (
            *map(format_headline, self._proposal.guesses),
            *missing,
            *(f"warning: {w}" for w in self.warnings),
        )

    @property
    def guesses(self) -> tuple[tuple[str, tuple[str, ...]], ...]:
        """A pair for each proposed signal: a sentence, and texts with the evidence for
        this proposal."""
        return tuple((format_headline(g), tuple(g.figures)) for g in self._proposal.guesses)

    @property
    def toml(self) -> str:
        """The text of signals.toml. Its comments give the reasons
        for each proposed signal."""
        return self._format_text(self._recording.path.parent)

    def _format_text(self, folder: Path) -> str:
        return format_signals(self._recording, self._proposal, self._how, folder)

    def write(self, path: PathLike) -> Path:
        """Write signals.toml, which read_log() and the commands read. An
        existing file is replaced."""
        if not self._proposal.guesses:
            raise UserError(
                f"{self._recording.path}: no signal could be proposed, so {path} is not written: write this "
                "file by hand; 'tselab estimate --help' shows its keys"
            )
        with write_atomically(Path(path)) as file:
            file.write(self._format_text(Path(path).parent))
        return Path(path)

    def to_dict(self) -> dict[str, Any]:
        """Return what `tselab signals --json` prints, as a dict."""
        found: dict[str, Any] = convert_to_plain(
            {
                "log": self._recording.path,
                "format": self.format,
                "signals": [vars(x) for x in self._lines],
                "proposal": {
                    g.channel: {k: v for k, v in vars(g).items() if k != "channel"}
                    for g in self._proposal.guesses
                },
                "missing": self.missing,
                "nearest": self.nearest,
                "warnings": self.warnings,
                "notes": self.notes,
            }
        )
        return found

    def to_frame(self) -> pd.DataFrame:
        """Return a table with a row per signal. Columns: name, unit, rate [Hz], low, high
        (range of the values), missing (share of missing values), used (channel for which
        the signal is proposed; "": none)."""
        return pd.DataFrame([vars(line) for line in self._lines])

    def _shown_rows(self) -> pd.DataFrame:
        rows = self.to_frame()
        return rows[rows["used"] != ""]

    def plot(self) -> Any:
        """Return a plotly figure: the proposed signals, each in the unit of the log."""
        there = {c.name: c for c in self._recording}
        return plots.draw_lines(
            [
                (
                    f"{g.channel} [{g.unit}]",
                    [(n, there[n].time, there[n].value) for n in g.name if n in there],
                )
                for g in self._proposal.guesses
            ]
        )


def signals(
    log: PathLike, vehicle: VehicleLike | None = None, *, databases: Sequence[PathLike] = ()
) -> Signals:
    """Propose for each channel (input of the filter) the signal of a log that contains
    it, as `tselab signals` does. The proposal uses the names and units of the signals,
    and physical relations between them.

    If there is a signals.toml next to the log, the log is read with the options in the
    table [log] of that file.

    Parameters
    ----------
    log
        A file of any format.
    vehicle
        As in estimate(). With the data of the vehicle, the physical
        checks are more accurate.
    databases
        Databases of the CAN bus, such as DBC files.

    Returns
    -------
    Signals
        The proposal. Check its `words`, call `write()` to write signals.toml next to the
        log, and correct wrong signals in that file.
    """
    _, how = find_signals(Path(log), None, tuple(map(Path, databases)))
    recording = read_recording(Path(log), how)
    return Signals(recording, propose(recording, None if vehicle is None else read_vehicle(vehicle)), how)
