"""What every reader gives: channels with their own time, unit and name, as they are in the file."""

from __future__ import annotations

import importlib
from array import array
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from pathlib import Path
from types import ModuleType

import numpy as np

from tse.impl.errors import UserError

MOST_NAMED = 6  # names that one message lists
PIECE = 1 << 16  # entries that are read, decoded or resampled at a time: 11 minutes at 100 Hz, 0.5 MB a column


@dataclass(frozen=True)
class Channel:
    """One signal of a log. `time`, s, and `value` have one entry per sample; NaN: missing. Channels of one message or table share
    the array `time`. Nothing is assumed of the time: reader and file are as they are, clock.py puts it right."""

    name: str
    time: np.ndarray
    value: np.ndarray
    unit: str = ""  # as the file says it; "": it does not
    text: str = ""  # what the file says about it

    @property
    def short(self) -> str:
        """The name without its message, group or topic."""
        return self.name.replace("/", ".").rpartition(".")[2]

    def __len__(self) -> int:
        return len(self.time)


@dataclass
class Recording:
    """A log as it is in its file."""

    path: Path
    format: str
    channels: dict[str, Channel]
    notes: list[str] = field(default_factory=list)
    start: float = 0.0  # s, what was taken off all times: an epoch, where they are of one

    def __iter__(self) -> Iterator[Channel]:
        return iter(self.channels.values())

    def find(self, name: str, source: str) -> Channel:
        """The channel of that name; the part after its message or topic is enough where only one has it. `source`: who asks, for
        the error."""
        if name in self.channels:
            return self.channels[name]
        alike = [c for c in self if c.short == name or c.name.endswith((f".{name}", f"/{name}"))]
        if len(alike) == 1:
            return alike[0]
        if alike:
            raise UserError(
                f"{source}: {name!r} is in {self.path.name} {len(alike)} times: say which: {listed(c.name for c in alike)}"
            )
        raise UserError(f"{source}: there is no {name!r} in {self.path.name}{near(name, self.channels)}")

    def has(self, name: str) -> bool:
        """Would find() find it?"""
        return (
            name in self.channels
            or sum(c.short == name or c.name.endswith((f".{name}", f"/{name}")) for c in self) == 1
        )

    def since_start(self) -> Recording:
        """Times counted from the first sample: an epoch in a double leaves less than a microsecond."""
        first = [
            float(c.time[i]) for c in self if len(c) and np.isfinite(c.time[i := int(np.isfinite(c.time).argmax())])
        ]
        if not first or abs(min(first)) < 1e6:
            return self
        start = float(np.floor(min(first)))
        moved: dict[int, np.ndarray] = {}
        for c in self:
            if id(c.time) not in moved:
                moved[id(c.time)] = c.time - start
        channels = {c.name: replace(c, time=moved[id(c.time)]) for c in self}
        return replace(self, channels=channels, start=self.start + start)


# ---- Columns that a file gives piece by piece: what a reader holds at a time beside them is PIECE entries.


class Growing:
    """A column that is filled from its beginning, and then an array."""

    def __init__(self) -> None:
        self._values = array("d")

    def __len__(self) -> int:
        return len(self._values)

    def extend(self, values: np.ndarray) -> None:
        """More numbers, (entries,)."""
        self._values.frombytes(np.ascontiguousarray(values, float).tobytes())

    def set(self, place: int, value: float) -> None:
        """The number at `place`, which is behind all others; those between are missing. Or again the last one."""
        self.pad(place)
        if place == len(self):
            self._values.append(value)
        else:
            self._values[-1] = value

    def pad(self, length: int) -> None:
        """So many are missing at the end as are needed for this length."""
        self._values.extend([np.nan] * (length - len(self)))

    def array(self) -> np.ndarray:
        """All of it, (entries,). Nothing can be added any more."""
        return np.frombuffer(self._values) if self._values else np.zeros(0)


class Later:
    """A column that is read when it is needed, in pieces. `rows`: how many it has; `pieces`: reads it, (entries,) at a time."""

    def __init__(self, rows: int, pieces: Callable[[], Iterable[np.ndarray]]):
        self._rows, self._pieces = rows, pieces
        self._found: np.ndarray | None = None

    def __len__(self) -> int:
        return self._rows

    def read(self) -> np.ndarray:
        """All of it as floats, (rows,)."""
        if self._found is None:
            column = Growing()
            for piece in self._pieces():
                column.extend(piece)
            self._found = column.array()
        return self._found


MOST_ROWS = 360_000_000  # of a signal: a hundred hours at 1 kHz


def check_rows(path: Path, what: str, rows: int) -> None:
    """Before anything of it is unpacked. UserError: more than a log can have, so it is none, or made to fill the machine."""
    if rows > MOST_ROWS:
        raise UserError(
            f"{path}: {what} has {rows:,} rows, it says; read are up to {MOST_ROWS:,}, a hundred hours at 1 kHz: cut it into drives"
        )


@dataclass(frozen=True)
class How:
    """Options of a reader: [log] of signals.toml, and options. `wanted`: which names are needed; None: all."""

    databases: tuple[Path, ...] = ()
    time: str | None = None
    time_unit: str | None = None
    step: float | None = None  # s between rows, for a table without a time
    separator: str | None = None
    decimal: str | None = None
    encoding: str | None = None
    header: int | None = None  # line of the names, from 1
    wanted: Callable[[str], bool] | None = None


def near(name: str, known: Iterable[str]) -> str:
    """A hint for a name that is not there."""
    known = list(known)
    lower = {k.lower(): k for k in known}
    short = {k.replace("/", ".").rpartition(".")[2].lower(): k for k in known}
    found = get_close_matches(name.lower(), [*lower, *short], 3, 0.6)
    if found:
        return f" (did you mean {listed(dict.fromkeys(lower.get(f) or short[f] for f in found))}?)"
    return f"; it has {listed(known)}; 'tselab signals LOG' lists them"


def listed(names: Iterable[str]) -> str:
    """Some names, and how many more."""
    names = list(names)
    more = len(names) - MOST_NAMED
    return ", ".join(names[:MOST_NAMED]) + (f" and {more} more" if more > 0 else "")


# ---- Libraries that are optional: what is not installed is named with the command that installs it.


def need(module: str, extra: str, what: str) -> ModuleType:
    """The module, or a sentence how to get it. `extra`: of pyproject.toml; `what`: that cannot be read without."""
    try:
        return importlib.import_module(module)
    except ImportError as error:
        package = module.partition(".")[0]
        why = (
            "is not installed"
            if isinstance(error, ModuleNotFoundError) and error.name == package
            else f"cannot be loaded ({error})"
        )
        raise UserError(
            f"{what}: the Python package {package} is needed and {why}: pip install 'tse[{extra}]'"
            f" (in a checkout: scripts/setup.sh logs)"
        ) from None
