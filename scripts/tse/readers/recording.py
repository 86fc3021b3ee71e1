"""Define Recording, which every reader returns, and functions that several readers need.

A Recording has the channels of a log with the times, units and names in its file. The
functions limit size, memory and time, import optional packages, and turn messages into
channels."""

from __future__ import annotations

import csv
import ctypes
import gc
import importlib
import itertools
import os
import re
import signal
import sys
import threading
import time
import traceback
from array import array
from collections.abc import Callable, Collection, Container, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from tse.library.errors import UserError

resource: Any
try:
    import resource
except ImportError:  # Windows
    resource = None

MAX_LISTED_NAMES = 6  # largest number of names that one message lists
CHUNK_ROWS = 1 << 16  # number of frames or rows of text that are decoded at a time
RECEIVER_TEXT = "receiver of GNSS"  # Channel.text of a channel that a GNSS receiver measures

# the point of an abbreviation, as in Lat._Vel, which does not separate two names
_ABBREVIATED = re.compile(r"(?<=[A-Za-z])\.(?=_|$)")


def last_part(name: str) -> str:
    """Return the last part of a path of names: wheel.fl and /car/fl give fl."""
    return re.split(r"[./]", _ABBREVIATED.sub("", name))[-1]


@dataclass(frozen=True)
class Channel:
    """One signal of a log.

    The channels of one message or table share one array `time`. The times may contain
    duplicates and jumps, which tse.log.clock repairs."""

    name: str
    time: np.ndarray  # [s] (samples,)
    value: np.ndarray  # (samples,); missing values are NaN
    unit: str = ""  # as in the file; "": the file states none
    text: str = ""  # description in the file
    # value -> its meaning, if the database of the bus gives names to single values
    states: Mapping[float, str] = field(default_factory=dict)

    @property
    def short(self) -> str:
        """Last part of the name, without the message, group or topic before it."""
        return last_part(self.name)

    def __len__(self) -> int:
        return len(self.time)


@dataclass
class Recording:
    """A log as its file contains it, before checks and repairs."""

    path: Path
    format: str
    channels: dict[str, Channel]
    notes: list[str] = field(default_factory=list)
    start: float = 0.0  # [s] time that was subtracted from all times, see since_start()

    def __iter__(self) -> Iterator[Channel]:
        return iter(self.channels.values())

    def find(self, name: str, source: str) -> Channel:
        """Return the channel of this name.

        The message or topic may be omitted from the name if only one channel then
        matches. Error messages begin with `source`, the setting or option that requests
        the channel."""
        if name in self.channels:
            return self.channels[name]
        alike = [c for c in self if c.short == name or c.name.endswith((f".{name}", f"/{name}"))]
        if len(alike) == 1:
            return alike[0]
        if alike:
            raise UserError(
                f"{source}: {name!r} is the name of {len(alike)} channels in {self.path.name}: "
                f"give the full name of one: {list_names(c.name for c in alike)}"
            )
        raise UserError(
            f"{source}: there is no {name!r} in {self.path.name}{suggest_channels(name, self.channels)}"
        )

    def has(self, name: str) -> bool:
        """Return whether find() finds exactly one channel by this name."""
        return (
            name in self.channels
            or sum(c.short == name or c.name.endswith((f".{name}", f"/{name}")) for c in self) == 1
        )

    def since_start(self) -> Recording:
        """Return the recording; times since 1970 become times since its start.

        The start time is the smallest of the first times of all channels. If it is below
        1e6 s in magnitude, the times are unchanged. Otherwise they are taken as counted
        from 1970: the start time, rounded down to whole seconds, is subtracted from all
        times and added to `start`. The rounding error of the times stays below 1 us."""
        first = [
            float(c.time[i])
            for c in self
            if len(c) and np.isfinite(c.time[i := int(np.isfinite(c.time).argmax())])
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


# ---- Columns that are read in parts.


class Growing:
    """A column of floats that grows: values are appended, then array() returns them."""

    def __init__(self) -> None:
        self._values = array("d")

    def __len__(self) -> int:
        return len(self._values)

    def extend(self, values: np.ndarray) -> None:
        """Append numbers."""
        self._values.frombytes(np.ascontiguousarray(values, float).tobytes())

    def set(self, place: int, value: float) -> None:
        """Set the value at index `place`, which must not be below the last index.

        If `place` is the last index, the value replaces the last value. If `place` is
        larger, the column is extended up to this index, and the values in between are
        NaN."""
        self.pad(place)
        if place == len(self):
            self._values.append(value)
        else:
            self._values[-1] = value

    def pad(self, length: int) -> None:
        """Extend the column to this length by NaN."""
        self._values.extend([np.nan] * (length - len(self)))

    def array(self) -> np.ndarray:
        """Return the column as an array that shares the memory of the column.

        Afterwards, no value can be appended, because Python refuses to resize shared
        memory."""
        return np.frombuffer(self._values) if self._values else np.zeros(0)


# ---- Limits of rows, memory and time: a small compressed file may unpack to far more
# than the memory holds.

ALWAYS_ALLOWED_ROWS = 1_500_000  # rows that a file of any size may have: 4 h at 100 Hz
# [bytes] least size in a file of: a value of a signal, a row of a table, a frame of a
# bus, a message. check_rows() derives from it how many of them a file can have
MIN_SIGNAL_BYTES, MIN_ROW_BYTES, MIN_FRAME_BYTES, MIN_MESSAGE_BYTES = 2, 5, 4, 8
MEMORY_LIMIT_VARIABLE = "TSE_HOLD_MEMORY"  # environment variable; if set, memory is limited
BASE_MEMORY = 700 << 20  # [bytes] memory that reading a file of any size may take
MEMORY_PER_BYTE = 16  # [bytes] additional memory that reading may take for each byte of the file


def measure_size(path: Path) -> int:
    """Return the size [bytes] of a file, or of all files in a folder."""
    if path.is_dir():
        return sum(p.stat().st_size for p in path.rglob("*") if p.is_file())
    return path.stat().st_size


def check_rows(path: Path, what: str, rows: int, each: int = MIN_SIGNAL_BYTES) -> None:
    """Refuse more rows than a file of this size can contain.

    A damaged or crafted file may state any number of rows. So call this function before
    the rows are unpacked into memory. The limit is the size of the file divided by
    `each`, the least number of bytes that a row takes in the file, but at least
    ALWAYS_ALLOWED_ROWS. `what` is the name of the table in the error message."""
    limit = ALWAYS_ALLOWED_ROWS
    if rows > limit:
        limit = max(limit, measure_size(path) // each)
    if rows > limit:
        raise UserError(
            f"{path}: {what} has {rows:,} rows; a file of its size may have up to {limit:,}: "
            "cut a long log into drives; if the log is short, its file is damaged or crafted to "
            "exhaust memory"
        )


MAX_COLUMNS = 20_000  # max number of columns of a table; the widest public log has 3 000
MAX_NAME_LENGTH = 1000  # max number of characters of the name of a column


def check_table_width(path: Path, names: Collection[str]) -> None:
    """Refuse a table that is too wide.

    Parameters
    ----------
    path : Path
        The file, for the error message.
    names : collection of str
        Names of all columns.

    Raises
    ------
    UserError
        There are more than MAX_COLUMNS columns, or a name is longer than MAX_NAME_LENGTH.
    """
    if len(names) > MAX_COLUMNS:
        raise UserError(
            f"{path}: has {len(names):,} columns; allowed: up to {MAX_COLUMNS:,}: "
            "remove the columns that are not needed"
        )
    long = next((n for n in names if len(n) > MAX_NAME_LENGTH), None)
    if long is not None:
        raise UserError(
            f"{path}: the name of a column has {len(long):,} characters ({long[:30]!r} ...); "
            f"allowed: up to {MAX_NAME_LENGTH:,}"
        )


@contextmanager
def limit_memory(path: Path) -> Iterator[None]:
    """Limit the additional memory that the process takes while it reads a file.

    The limit is BASE_MEMORY plus MEMORY_PER_BYTE for each byte of the file. It acts on
    Linux only, and only if the environment variable MEMORY_LIMIT_VARIABLE is set. The
    command tselab sets it for itself and its workers. tse does not, because the limit
    applies to the whole program that imports tse.

    Raises
    ------
    UserError
        Reading takes more memory than the limit.
    """
    taken = _read_data_size() if MEMORY_LIMIT_VARIABLE in os.environ and path.exists() else None
    if taken is None:
        yield
        return
    room = BASE_MEMORY + MEMORY_PER_BYTE * measure_size(path)
    before = resource.getrlimit(resource.RLIMIT_DATA)
    limit = taken + room if before[0] == resource.RLIM_INFINITY else min(taken + room, before[0])
    resource.setrlimit(resource.RLIMIT_DATA, (limit, before[1]))
    try:
        yield
    except MemoryError:
        raise UserError(
            f"{path}: reading takes more than {room / 2**30:.1f} GB of memory, the limit for its size: "
            "cut a long log into drives; if the log is short, it is damaged, or crafted to exhaust memory"
        ) from None
    finally:
        resource.setrlimit(resource.RLIMIT_DATA, before)


BASE_READ_TIME = 30.0  # [s] processor time that reading a file of any size may take
READ_TIME_PER_MB = 3.0  # [s] additional processor time that reading may take for each MB of the file


class _TookLong(BaseException):
    """Interrupts a reader that exceeds its time.

    It derives from BaseException, because parsers of other packages catch Exception and
    would then continue."""


@contextmanager
def limit_time(path: Path) -> Iterator[None]:
    """Limit the processor time for reading a file.

    Parameters
    ----------
    path : Path
        The file. Its size determines the limit.

    Raises
    ------
    UserError
        Reading takes longer than the limit, e.g. because links between the blocks of the
        file form a circle.

    Notes
    -----
    _TookLong is raised in the reader: in the main thread by a timer signal, in any other
    thread and on Windows by a second thread. Compiled code is not interrupted before it
    returns to Python. Of nested calls of limit_time(), only the outermost sets a limit.
    """
    limit = BASE_READ_TIME + READ_TIME_PER_MB * measure_size(path) / 2**20 if path.exists() else 0.0
    is_main = threading.current_thread() is threading.main_thread()
    has_signals = is_main and hasattr(signal, "setitimer")
    if not has_signals and limit and not getattr(_THREAD, "watched", False):
        with _watch_thread(path, limit):
            yield
        return
    if not has_signals or not limit or signal.getitimer(signal.ITIMER_VIRTUAL)[0] > 0:
        yield
        return

    def stop(*_: object) -> None:
        raise _TookLong

    before = signal.signal(signal.SIGVTALRM, stop)
    # repeat the signal each second, because a parser may catch the exception
    signal.setitimer(signal.ITIMER_VIRTUAL, limit, 1.0)
    try:
        yield
    except _TookLong as error:
        _release_frames(error)
        raise _make_time_error(path, limit) from None
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0.0)
        signal.signal(signal.SIGVTALRM, before)


def _make_time_error(path: Path, limit: float) -> UserError:
    """Return the error of a file that takes more than `limit` seconds to read."""
    return UserError(
        f"{path}: reading takes more than {limit:.0f} s, the limit for its size: cut a long log into "
        "drives; if the log is short, it is damaged (links between its blocks form a circle), or crafted to "
        "keep the machine busy"
    )


_THREAD = threading.local()  # .watched: True while _watch_thread() limits this thread


def _measure_work(ident: int) -> float:
    """Return the processor time [s] of a thread.

    If the system does not measure it, return the time [s] of a monotonic clock."""
    try:
        return time.clock_gettime(time.pthread_getcpuclockid(ident))
    except (AttributeError, OSError):
        return time.monotonic()


@contextmanager
def _watch_thread(path: Path, limit: float) -> Iterator[None]:
    """Limit the processor time of the current thread to `limit` [s]. A second thread
    measures this time, and interrupts the current thread when the limit is exceeded."""
    ident, ended = threading.get_ident(), threading.Event()
    begin, interrupt = _measure_work(ident), ctypes.pythonapi.PyThreadState_SetAsyncExc

    def interrupt_late() -> None:
        while not ended.wait(min(1.0, limit)):
            # repeated each second, because a parser may catch the exception
            if _measure_work(ident) - begin > limit:
                interrupt(ctypes.c_ulong(ident), ctypes.py_object(_TookLong))

    watcher = threading.Thread(target=interrupt_late, daemon=True, name="watchdog of a reader")
    _THREAD.watched = True
    watcher.start()
    try:
        try:
            yield
        finally:
            _THREAD.watched = False
            ended.set()
            watcher.join()
            interrupt(ctypes.c_ulong(ident), None)  # cancel an interrupt that is not raised yet
    except _TookLong as error:
        _release_frames(error)
        raise _make_time_error(path, limit) from None


def _release_frames(error: BaseException) -> None:
    """Release the objects of an interrupted reader, which the traceback of `error` keeps.

    Messages of their methods __del__() are suppressed."""
    hook = sys.unraisablehook
    sys.unraisablehook = lambda _: None
    try:
        traceback.clear_frames(error.__traceback__)
        error.__traceback__ = error.__context__ = None
        gc.collect()
    finally:
        sys.unraisablehook = hook


MAX_CELL_LENGTH = 1 << 16  # characters
# [characters] Python's module csv refuses longer cells. Its default, 131 072, is too low:
# for a wrong separator, a line of up to 2^20 characters is one cell
csv.field_size_limit(1 << 22)


def split_cells(
    path: Path, line: str, separator: str = ",", blanks: bool = False, tried: bool = False
) -> list[str]:
    """Return the cells of a line of CSV.

    Parameters
    ----------
    path : Path
        The file, for the error message.
    line : str
        The line.
    separator : str
        Character between the cells.
    blanks : bool
        Skip blanks after the separator.
    tried : bool
        True: the separator is only tried. Long cells are no error then, because a wrong
        separator leaves the whole line as a single cell.

    Returns
    -------
    list of str
        Empty for an empty line.

    Raises
    ------
    UserError
        A cell has more than MAX_CELL_LENGTH characters.
    """
    try:
        cells = next(csv.reader([line], delimiter=separator, skipinitialspace=blanks), [])
    except csv.Error as error:
        raise UserError(
            f"{path}: a line cannot be split into cells: {error}; it begins with {line[:30]!r}"
        ) from None
    long = next((c for c in cells if len(c) > MAX_CELL_LENGTH), None)
    if long is not None and not tried:
        raise UserError(
            f"{path}: a cell has {len(long):,} characters; allowed: up to {MAX_CELL_LENGTH:,}; "
            f"it begins with {long[:30]!r}"
        )
    return cells


def _read_data_size() -> int | None:
    """Return the size [bytes] of the process's data; None if the system reports none."""
    if resource is None:
        return None
    try:
        said = re.search(r"VmData:\s+(\d+) kB", Path("/proc/self/status").read_text(encoding="ascii"))
    except OSError:
        return None
    return int(said[1]) << 10 if said else None


@dataclass(frozen=True)
class ReadOptions:
    """Options of a reader, from table [log] of signals.toml and from the command line."""

    databases: tuple[Path, ...] = ()  # databases of the bus; (): those in the folder of the log
    # If one of the following members is None, the reader finds its value from the file.
    # Exceptions: `step` and `wanted`
    time: str | None = None  # name of the time column
    time_unit: str | None = None
    # [s] time between the rows of a table without a time column; None: it is refused
    step: float | None = None
    separator: str | None = None  # character between the cells of a CSV
    decimal: str | None = None  # decimal sign of a CSV
    encoding: str | None = None
    header: int | None = None  # number of the line with the names of a CSV, from 1
    wanted: Callable[[str], bool] | None = None  # returns whether a channel is needed; None: all are


def find_unused_name(name: str, taken: Container[str]) -> str:
    """Return the name, or NAME#2, NAME#3 ... if it is taken."""
    return next(n for k in itertools.count(1) if (n := f"{name}#{k}" if k > 1 else name) not in taken)


def suggest_channels(name: str, known: Iterable[str]) -> str:
    """Return the end of a message about a missing channel: similar or known names."""
    known = list(known)
    lower = {k.lower(): k for k in known}
    short = {k.replace("/", ".").rpartition(".")[2].lower(): k for k in known}
    found = get_close_matches(name.lower(), [*lower, *short], 3, 0.6)
    if found:
        return f" (did you mean {list_names(dict.fromkeys(lower.get(f) or short[f] for f in found))}?)"
    return f"; it has {list_names(known)}; 'tselab signals LOG' lists them"


def list_names(names: Iterable[str]) -> str:
    """Return the first MAX_LISTED_NAMES names, and the number of the omitted names."""
    names = list(names)
    more = len(names) - MAX_LISTED_NAMES
    return ", ".join(names[:MAX_LISTED_NAMES]) + (f" and {more} more" if more > 0 else "")


# ---- Optional packages. If one is missing, the error message states how to install it


def import_optional(module: str, extra: str, what: str) -> ModuleType:
    """Import an optional package.

    Parameters
    ----------
    module : str
        Module to import.
    extra : str
        Extra of tse that installs the package, for the error message. An extra is a list
        of optional packages in pyproject.toml, e.g. ros in pip install 'tse[ros]'.
    what : str
        The file that needs the package, for the error message.

    Raises
    ------
    UserError
        The package is not installed, or cannot be loaded.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        package = module.partition(".")[0]
        why = f"cannot be loaded ({error})"
        if isinstance(error, ModuleNotFoundError) and error.name == package:
            why = "is not installed"
        raise UserError(
            f"{what}: the Python package {package} is needed and {why}: pip install 'tse[{extra}]'"
            f" (in a checkout: scripts/setup.sh logs)"
        ) from None


# ---- Messages of ROS, MCAP, JSON and Cap'n Proto: one channel for each field.

# Length of the longest array whose elements become channels. A longer array is skipped.
# An array with one element per wheel has at most this length; an image or the covariance
# matrix of a pose is longer
MAX_ARRAY_CHANNELS = 12
MAX_MESSAGE_DEPTH = 8  # levels of nested fields that are read
# Name of a field, e.g. linear_acceleration -> unit of the fields in it, e.g.
# linear_acceleration.x, as defined in REP 103, sensor_msgs and nav_msgs
ROS_UNITS = {"angular_velocity": "rad/s", "linear_acceleration": "m/s2", "linear": "m/s", "angular": "rad/s"}
ROS_TYPES = ("sensor_msgs", "geometry_msgs", "nav_msgs")


def flatten_message(message: Any, at: str = "", depth: int = 0) -> Iterator[tuple[str, float]]:
    """Yield the numbers of a message with their paths: angular_velocity.z, wheels.0."""
    if isinstance(message, (bool, int, float, np.integer, np.floating, np.bool_)):
        yield at, float(message)
        return
    if depth > MAX_MESSAGE_DEPTH or isinstance(message, (str, bytes)) or message is None:
        return
    if isinstance(message, dict):
        items = message.items()
    elif isinstance(message, (list, tuple, np.ndarray)):
        if len(message) > MAX_ARRAY_CHANNELS or "covariance" in at:
            return
        items = ((str(i), x) for i, x in enumerate(message))
    else:
        names = getattr(message, "__slots__", None) or getattr(message, "__dataclass_fields__", None)
        if names is None:
            return
        items = (
            (str(n).lstrip("_"), getattr(message, n, None)) for n in names if not str(n).startswith("__")
        )
    for name, part in items:
        if name in ("header", "check_fields", "_check_fields"):
            continue
        yield from flatten_message(part, f"{at}.{name}" if at else name, depth + 1)


def read_stamp(message: Any) -> float | None:
    """Return the time of measurement [s] in the header of a ROS message.

    If the message has no header with a time, or the seconds of the time are 0 because it
    was not set, return None."""
    header = message.get("header") if isinstance(message, dict) else getattr(message, "header", None)
    s = header.get("stamp") if isinstance(header, dict) else getattr(header, "stamp", None)
    if s is None:
        return None
    get = s.get if isinstance(s, dict) else lambda k, d=None: getattr(s, k, d)
    sec = next((get(k) for k in ("sec", "secs") if get(k) is not None), None)
    nano = next((get(k) for k in ("nanosec", "nsecs", "nsec") if get(k) is not None), 0)
    return float(sec) + 1e-9 * float(nano) if sec else None


@dataclass
class _Topic:
    """The messages of one topic: their times, and a column of values for each field."""

    type: str
    time: Growing
    # path of a field -> values of the field; None: the field is not needed
    columns: dict[str, Growing | None] = field(default_factory=dict)


class Collector:
    """Collects the fields of messages as channels.

    `wanted` returns whether a channel is needed. None: all are."""

    def __init__(self, path: Path, wanted: Callable[[str], bool] | None = None) -> None:
        self._path, self._wanted = path, wanted
        self._topics: dict[str, _Topic] = {}
        self._messages = 0

    def add(self, topic: str, time: float, message: Any, type_: str = "") -> None:
        """Add one message.

        The values of the message get the time in its header or, if there is none, `time`:
        the time [s] of logging, as in the file. `type_`: type of the message, which
        determines the units of its fields.

        Raises
        ------
        UserError
            The file has too many messages for its size.
        """
        self._messages += 1
        if self._messages % CHUNK_ROWS == 0:
            check_rows(self._path, "the recording", self._messages, MIN_MESSAGE_BYTES)
        own = self._topics.get(topic)
        if own is None:
            own = self._topics[topic] = _Topic(type_, Growing())
        row = len(own.time)
        measured = read_stamp(message)
        own.time.set(row, time if measured is None else measured)
        for name, value in flatten_message(message):
            if name not in own.columns:
                needed = self._wanted is None or self._wanted(_join_path(topic, name))
                own.columns[name] = Growing() if needed else None
            if (column := own.columns[name]) is not None:
                column.set(row, value)

    def channels(self) -> dict[str, Channel]:
        """Return the channels by name, TOPIC.PATH: /imu.angular_velocity.z."""
        found: dict[str, Channel] = {}
        for topic, own in self._topics.items():
            time = own.time.array()
            for name, column in own.columns.items():
                if column is not None:
                    column.pad(len(time))
                    full = _join_path(topic, name)
                    found[full] = Channel(full, time, column.array(), _find_unit(own.type, name), own.type)
        return found


def _join_path(topic: str, name: str) -> str:
    """Return the name of the channel of a field: TOPIC.PATH."""
    return f"{topic}.{name}" if name else topic


def _find_unit(type_: str, name: str) -> str:
    """Return the unit of a field; "" if the type of its message defines none."""
    if not type_.startswith(ROS_TYPES):
        return ""
    parts = name.split(".")
    parent = parts[-2] if len(parts) > 1 else ""
    if parent == "linear" and "Accel" in type_:
        return "m/s2"
    return ROS_UNITS.get(parent, "")
