"""Logs in files of many formats and in memory, and the proposal of signals for their
channels."""

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

from tse._base import Array
from tse._shown import Shown, make_figure
from tse._vehicle import VehicleLike, read_vehicle
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
    """A log that is read and checked: rows in SI units, ISO 8855."""

    def __init__(self, checked: Checked):
        self._checked = checked
        self.path = checked.path
        """The file."""
        self.notes = tuple(checked.notes)
        """What was odd, or was filled in, in words."""
        self.warnings = tuple(checked.warnings)
        """Of the notes those that say what may be wrong."""

    def __len__(self) -> int:
        return len(self._checked)

    @property
    def time(self) -> Array:
        """(n,) s."""
        return np.asarray(self._checked.time, float)

    @property
    def sample_time(self) -> float | None:
        """s, usual time between rows."""
        return self._checked.sample_time

    @property
    def words(self) -> tuple[str, ...]:
        """Rows, duration and notes."""
        span = float(self.time[-1] - self.time[0]) if len(self) else 0.0
        return (f"{self.path.name}: {len(self)} rows, {span:.1f} s", *self.notes)

    def to_frame(self) -> pd.DataFrame:
        """Return the rows: time, channels, optional channels, columns ref_..., as
        estimate() takes them."""
        parts = (self._checked.data, self._checked.extra, self._checked.ref)
        return pd.concat(
            [pd.Series(self.time, name="time"), *(p.reset_index(drop=True) for p in parts)], axis=1
        )

    def plot(self) -> Any:
        """Return a figure of plotly: the channels over time."""
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
        CSV, Parquet, MF4, BLF, MCAP, ROS bag, MAT, openpilot ...
    vehicle
        As in estimate(): wheel radii and steering ratio, which speeds of wheels and
        angles of the steering wheel need.
    signals
        The file that says which signal is which channel; None: the one beside the log,
        else they are guessed.
    rate
        Hz of the rows; None: that of the log, or of `signals`.
    strict
        Refuse what else is a warning.
    databases
        DBC files of the bus.

    Returns
    -------
    Log
        For estimate(), calibrate(), gap() and replay().

    Raises
    ------
    FileNotFoundError
        The file is not there.
    Error
        It is damaged, or lacks a channel that is needed; a ValueError. The text names
        file, line and column.
    """
    car = None if vehicle is None else read_vehicle(vehicle)
    file = Path(signals) if signals is not None else None
    return Log(_read_log(Path(path), reading=Reading(file, rate, strict, tuple(map(Path, databases)), car)))


def read_checked(log: LogLike, car: Vehicle, name: str = "log", reading: Reading | None = None) -> Checked:
    """Read and check a log of any kind. `name`: that of a log in memory. TypeError: it is
    no log."""
    if isinstance(log, str | os.PathLike):
        return _read_log(Path(log), reading=replace(reading or Reading(), car=car))
    return adapt_to_car(log._checked if isinstance(log, Log) else read_frame(_read_columns(log), name), car)


def read_known_road(road: PathLike | Road | None) -> Road | None:
    """Return a road: read it if `road` is a file."""
    return road if road is None or isinstance(road, Road) else read_road(Path(road))


def collect_logs(logs: LogLike | Sequence[LogLike], car: Vehicle, min_logs: int = 1) -> list[Path | Checked]:
    """Return files as paths, and logs in memory checked, by their number. UserError:
    there are fewer than `min_logs`."""
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
    """Return the columns of a log in memory."""
    if isinstance(frame, np.ndarray) and frame.dtype.names:
        return {name: frame[name] for name in frame.dtype.names}
    if isinstance(frame, pd.DataFrame | Mapping):
        return frame
    if callable(getattr(frame, "to_pandas", None)):  # a table of pyarrow, a frame of polars
        return pd.DataFrame(frame.to_pandas())
    wanted = "give a file, a data frame, a dict of arrays or a structured array"
    if isinstance(frame, np.ndarray):
        raise TypeError(f"an array without names of fields; {wanted}")
    if isinstance(frame, list | tuple):
        raise TypeError(f"a {type(frame).__name__} is no log; {wanted}, such as pd.DataFrame(...) of it")
    raise TypeError(f"{type(frame).__name__} is no log; {wanted}")


# ---- which signal is which channel


class Signals(Shown):
    """Proposal of the signal for each channel of a log."""

    def __init__(self, recording: Recording, proposal: Proposal, how: ReadOptions):
        self._recording, self._proposal, self._how = recording, proposal, how
        self.format = recording.format
        """Format of the log, in words."""
        self.missing = tuple(proposal.missing)
        """Channels for which nothing was found."""
        self.nearest = {c: tuple(x) for c, x in proposal.nearest.items()}
        """For each missing channel the signals that come nearest, and what is against
        each."""
        self.warnings = tuple(proposal.warnings)
        """What is doubtful, in words."""
        self.notes = tuple(recording.notes)
        """What was odd when the log was read, in words."""

    @cached_property
    def _lines(self) -> list[Line]:
        return list_signals(self._recording, self._proposal)

    @property
    def words(self) -> tuple[str, ...]:
        """A sentence for each guess, and what was not found."""
        missing = [f"not found: {', '.join(self.missing)}"] if self.missing else []
        return (
            *map(format_headline, self._proposal.guesses),
            *missing,
            *(f"warning: {w}" for w in self.warnings),
        )

    @property
    def guesses(self) -> tuple[tuple[str, tuple[str, ...]], ...]:
        """A sentence for each guess, with the figures that speak for it."""
        return tuple((format_headline(g), tuple(g.figures)) for g in self._proposal.guesses)

    @property
    def toml(self) -> str:
        """The text of signals.toml, with what speaks for each guess as comments."""
        return self._text(self._recording.path.parent)

    def _text(self, folder: Path) -> str:
        return format_signals(self._recording, self._proposal, self._how, folder)

    def write(self, path: PathLike) -> Path:
        """Write signals.toml, for read_log() and the commands; one that is there is
        replaced."""
        if not self._proposal.guesses:
            raise UserError(f"{self._recording.path}: nothing could be guessed, so {path} is not written")
        with write_atomically(Path(path)) as file:
            file.write(self._text(Path(path).parent))
        return Path(path)

    def to_dict(self) -> dict[str, Any]:
        """Return the document of `tselab signals --json`."""
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
        """Return a row per signal: name, unit, rate [Hz], low, high, missing (share),
        used.

        `used` is the channel that the signal is proposed for."""
        return pd.DataFrame([vars(line) for line in self._lines])

    def _shown_rows(self) -> pd.DataFrame:
        rows = self.to_frame()
        return rows[rows["used"] != ""]

    def plot(self) -> Any:
        """Return a figure of plotly: the signals that are proposed, each in the unit that
        it is logged in."""
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
    """Propose which signal of a log is which channel, by names, units and physics, as
    `tselab signals` does.

    The log is read as [log] of the signals.toml beside it says, if there is one.

    Parameters
    ----------
    log
        A file of any format.
    vehicle
        As in estimate(); makes the figures sharper.
    databases
        DBC files of the bus.

    Returns
    -------
    Signals
        Look through `words`, `write()` it beside the log, and correct what is wrong.
    """
    _, how = find_signals(Path(log), None, tuple(map(Path, databases)))
    recording = read_recording(Path(log), how)
    return Signals(recording, propose(recording, None if vehicle is None else read_vehicle(vehicle)), how)
