"""The result of every reader: channels with times, units and names as in the file."""

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

MAX_LISTED_NAMES = 6  # in one message
CHUNK_ROWS = 1 << 16  # frames or rows of text that are decoded at a time
RECEIVER_TEXT = "receiver of GNSS"  # text of a channel that comes from such a receiver

_ABBREVIATED = re.compile(r"(?<=[A-Za-z])\.(?=_|$)")  # the point of Lat._Vel separates no names


def last_part(name: str) -> str:
    """Return the last name of a path of names: wheel.fl and /car/fl give fl."""
    return re.split(r"[./]", _ABBREVIATED.sub("", name))[-1]


@dataclass(frozen=True)
class Channel:
    """One signal of a log.

    Channels of one message or table share the array `time`. It may have duplicates and
    jumps: tse.log.clock repairs them."""

    name: str
    time: np.ndarray  # s, (samples,)
    value: np.ndarray  # (samples,); NaN: missing
    unit: str = ""  # as in the file; "": none is given
    text: str = ""  # description in the file
    states: Mapping[float, str] = field(default_factory=dict)  # names of single values, from a database

    @property
    def short(self) -> str:
        """The name without message, group or topic."""
        return last_part(self.name)

    def __len__(self) -> int:
        return len(self.time)


@dataclass
class Recording:
    """A log as it is in its file."""

    path: Path
    format: str
    channels: dict[str, Channel]
    notes: list[str] = field(default_factory=list)
    start: float = 0.0  # s, subtracted from all times: the epoch

    def __iter__(self) -> Iterator[Channel]:
        return iter(self.channels.values())

    def find(self, name: str, source: str) -> Channel:
        """Return the channel of this name.

        The name without message or topic is enough if only one channel has it. `source`
        names the origin of the request in the error."""
        if name in self.channels:
            return self.channels[name]
        alike = [c for c in self if c.short == name or c.name.endswith((f".{name}", f"/{name}"))]
        if len(alike) == 1:
            return alike[0]
        if alike:
            raise UserError(
                f"{source}: {name!r} is in {self.path.name} {len(alike)} times: say which: "
                f"{list_names(c.name for c in alike)}"
            )
        raise UserError(
            f"{source}: there is no {name!r} in {self.path.name}{suggest_channels(name, self.channels)}"
        )

    def has(self, name: str) -> bool:
        """Return whether find() would find the name."""
        return (
            name in self.channels
            or sum(c.short == name or c.name.endswith((f".{name}", f"/{name}")) for c in self) == 1
        )

    def since_start(self) -> Recording:
        """Return the recording with times since its first sample.

        A double resolves an epoch to less than a microsecond."""
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


# ---- Columns that a file gives in parts.


class Growing:
    """A column that grows at its end and becomes an array."""

    def __init__(self) -> None:
        self._values = array("d")

    def __len__(self) -> int:
        return len(self._values)

    def extend(self, values: np.ndarray) -> None:
        """Append numbers."""
        self._values.frombytes(np.ascontiguousarray(values, float).tobytes())

    def set(self, place: int, value: float) -> None:
        """Write the last number, or one at a later place; skipped places are missing."""
        self.pad(place)
        if place == len(self):
            self._values.append(value)
        else:
            self._values[-1] = value

    def pad(self, length: int) -> None:
        """Extend the column to this length by missing values."""
        self._values.extend([np.nan] * (length - len(self)))

    def array(self) -> np.ndarray:
        """Return the column. It cannot grow afterwards."""
        return np.frombuffer(self._values) if self._values else np.zeros(0)


# ---- Limits. A compressed file may be made to fill the machine.

ALWAYS_ALLOWED_ROWS = 1_500_000  # 4 h at 100 Hz; allowed for files of any size
# minimum bytes of a file for a value of a signal, a row of a table, a frame, a message
MIN_SIGNAL_BYTES, MIN_ROW_BYTES, MIN_FRAME_BYTES, MIN_MESSAGE_BYTES = 2, 5, 4, 8
MEMORY_LIMIT_VARIABLE = "TSE_HOLD_MEMORY"  # environment variable that switches the limit on
BASE_MEMORY = 700 << 20  # bytes that reading any file may take
MEMORY_PER_BYTE = 16  # additional bytes for each byte of the file


def measure_size(path: Path) -> int:
    """Return the size of a file, or of all files in a folder, bytes."""
    if path.is_dir():
        return sum(p.stat().st_size for p in path.rglob("*") if p.is_file())
    return path.stat().st_size


def check_rows(path: Path, what: str, rows: int, each: int = MIN_SIGNAL_BYTES) -> None:
    """Refuse a number of rows that the size of the file does not explain.

    To be called before unpacking. `what`: its name in the message; `each`: minimum bytes
    of the file per row."""
    most = ALWAYS_ALLOWED_ROWS
    if rows > most:
        most = max(most, measure_size(path) // each)
    if rows > most:
        raise UserError(
            f"{path}: {what} has {rows:,} rows; a file of its size may have up to {most:,} "
            "(any file four hours at 100 Hz): cut it into drives; or it is made to fill the machine"
        )


MAX_COLUMNS = 20_000  # of a table; the largest of public logs has 3 000
MAX_NAME_LENGTH = 1000  # characters


def check_table_width(path: Path, names: Collection[str]) -> None:
    """Refuse a table that is too wide.

    Parameters
    ----------
    path : Path
        The file, for the message.
    names : collection of str
        Names of all columns.

    Raises
    ------
    UserError
        There are more than MAX_COLUMNS, or a name is longer than MAX_NAME_LENGTH.
    """
    if len(names) > MAX_COLUMNS:
        raise UserError(
            f"{path}: has {len(names):,} columns; up to {MAX_COLUMNS:,} are read: "
            "leave out those that are not needed"
        )
    long = next((n for n in names if len(n) > MAX_NAME_LENGTH), None)
    if long is not None:
        raise UserError(
            f"{path}: the name of a column has {len(long):,} characters ({long[:30]!r} ...); "
            f"up to {MAX_NAME_LENGTH:,} are read"
        )


@contextmanager
def limit_memory(path: Path) -> Iterator[None]:
    """Limit the memory of the process while it reads a file.

    The limit needs Linux and MEMORY_LIMIT_VARIABLE, which commands set for themselves and
    their workers. In other programs it would also limit their own work.

    Raises
    ------
    UserError
        Reading takes more memory than the size of the file allows.
    """
    taken = _read_data_size() if MEMORY_LIMIT_VARIABLE in os.environ and path.exists() else None
    if taken is None:
        yield
        return
    room = BASE_MEMORY + MEMORY_PER_BYTE * measure_size(path)
    before = resource.getrlimit(resource.RLIMIT_DATA)
    most = taken + room if before[0] == resource.RLIM_INFINITY else min(taken + room, before[0])
    resource.setrlimit(resource.RLIMIT_DATA, (most, before[1]))
    try:
        yield
    except MemoryError:
        raise UserError(
            f"{path}: takes more than {room / 2**30:.1f} GB of memory to read, far more than its "
            "size allows: it is damaged, made to fill the machine, or very long: cut it into drives"
        ) from None
    finally:
        resource.setrlimit(resource.RLIMIT_DATA, before)


BASE_READ_TIME = 30.0  # s of the processor that reading any file may take
READ_TIME_PER_MB = 3.0  # additional s for each MB


class _TookLong(BaseException):
    """Too long reading. No Exception, because parsers of other packages catch those."""


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
        Reading takes longer: the blocks of the file form a circle, or it is made to.

    Notes
    -----
    Signals reach the main thread only. In other threads, and on Windows, a second thread
    watches; it cannot stop a library that does not return to Python. Of nested blocks the
    outermost sets the limit.
    """
    most = BASE_READ_TIME + READ_TIME_PER_MB * measure_size(path) / 2**20 if path.exists() else 0.0
    is_main = threading.current_thread() is threading.main_thread()
    has_signals = is_main and hasattr(signal, "setitimer")
    if not has_signals and most and not getattr(_THREAD, "watched", False):
        with _watch_thread(path, most):
            yield
        return
    if not has_signals or not most or signal.getitimer(signal.ITIMER_VIRTUAL)[0] > 0:
        yield
        return

    def stop(*_: object) -> None:
        raise _TookLong

    before = signal.signal(signal.SIGVTALRM, stop)
    signal.setitimer(signal.ITIMER_VIRTUAL, most, 1.0)  # repeated each second: a parser may catch it
    try:
        yield
    except _TookLong as error:
        _release_frames(error)
        raise _make_time_error(path, most) from None
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0.0)
        signal.signal(signal.SIGVTALRM, before)


def _make_time_error(path: Path, most: float) -> UserError:
    """Return the error of a file that takes more than `most` seconds to read."""
    return UserError(
        f"{path}: takes more than {most:.0f} s to read, far more than its size allows: its blocks form "
        "a circle, or it is made to keep a machine busy"
    )


_THREAD = threading.local()  # watched: True if another thread watches this one


def _measure_work(ident: int) -> float:
    """Return the processor time of a thread, s; else, if there is none, a clock."""
    try:
        return time.clock_gettime(time.pthread_getcpuclockid(ident))
    except (AttributeError, OSError):
        return time.monotonic()


@contextmanager
def _watch_thread(path: Path, most: float) -> Iterator[None]:
    """Limit the time of a thread without signals: another thread interrupts it."""
    ident, ended = threading.get_ident(), threading.Event()
    begin, interrupt = _measure_work(ident), ctypes.pythonapi.PyThreadState_SetAsyncExc

    def interrupt_late() -> None:
        while not ended.wait(min(1.0, most)):
            if _measure_work(ident) - begin > most:  # each second again: a parser may catch it
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
            interrupt(ctypes.c_ulong(ident), None)  # cancel an interrupt that is still to come
    except _TookLong as error:
        _release_frames(error)
        raise _make_time_error(path, most) from None


def _release_frames(error: BaseException) -> None:
    """Release what a reader had opened, without messages about unfinished objects."""
    hook = sys.unraisablehook
    sys.unraisablehook = lambda _: None
    try:
        traceback.clear_frames(error.__traceback__)
        error.__traceback__ = error.__context__ = None
        gc.collect()
    finally:
        sys.unraisablehook = hook


MAX_CELL_LENGTH = 1 << 16  # characters
# larger than any line that is read: a wrong separator makes one cell of a whole line
csv.field_size_limit(1 << 22)


def split_cells(
    path: Path, line: str, separator: str = ",", blanks: bool = False, tried: bool = False
) -> list[str]:
    """Return the cells of a line of CSV.

    Parameters
    ----------
    path : Path
        The file, for the message.
    line : str
        The line.
    separator : str
        Character between the cells.
    blanks : bool
        Skip blanks after the separator.
    tried : bool
        The separator is only tried: accept long cells.

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
            f"{path}: a line is no row of a table: {error}; it begins with {line[:30]!r}"
        ) from None
    long = next((c for c in cells if len(c) > MAX_CELL_LENGTH), None)
    if long is not None and not tried:
        raise UserError(
            f"{path}: a cell has {len(long):,} characters; up to {MAX_CELL_LENGTH:,} are read: "
            f"{long[:30]!r} ..."
        )
    return cells


def _read_data_size() -> int | None:
    """Return the data size of the process, bytes; None if the system has no value."""
    if resource is None:
        return None
    try:
        said = re.search(r"VmData:\s+(\d+) kB", Path("/proc/self/status").read_text(encoding="ascii"))
    except OSError:
        return None
    return int(said[1]) << 10 if said else None


@dataclass(frozen=True)
class ReadOptions:
    """Options of a reader: [log] of signals.toml, and options of the command."""

    databases: tuple[Path, ...] = ()
    time: str | None = None
    time_unit: str | None = None
    step: float | None = None  # s between rows, for a table without a time
    separator: str | None = None
    decimal: str | None = None
    encoding: str | None = None
    header: int | None = None  # line of the names, from 1
    wanted: Callable[[str], bool] | None = None  # True for the names that are needed; None: all


def find_unused_name(name: str, taken: Container[str]) -> str:
    """Return the name, or NAME#2, NAME#3 ... if it is taken."""
    return next(n for k in itertools.count(1) if (n := f"{name}#{k}" if k > 1 else name) not in taken)


def suggest_channels(name: str, known: Iterable[str]) -> str:
    """Return a hint for a channel that does not exist: similar names, or all."""
    known = list(known)
    lower = {k.lower(): k for k in known}
    short = {k.replace("/", ".").rpartition(".")[2].lower(): k for k in known}
    found = get_close_matches(name.lower(), [*lower, *short], 3, 0.6)
    if found:
        return f" (did you mean {list_names(dict.fromkeys(lower.get(f) or short[f] for f in found))}?)"
    return f"; it has {list_names(known)}; 'tselab signals LOG' lists them"


def list_names(names: Iterable[str]) -> str:
    """Return the first names, and the number of the others."""
    names = list(names)
    more = len(names) - MAX_LISTED_NAMES
    return ", ".join(names[:MAX_LISTED_NAMES]) + (f" and {more} more" if more > 0 else "")


# ---- Optional packages: the error of a missing one contains the command to install it.


def import_optional(module: str, extra: str, what: str) -> ModuleType:
    """Import an optional package.

    Parameters
    ----------
    module : str
        Its module.
    extra : str
        The extra of pyproject.toml that installs it.
    what : str
        The file that needs it, for the message.

    Raises
    ------
    UserError
        It is not installed, or cannot be loaded.
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


# ---- Messages of ROS, MCAP, JSON and Cap'n Proto: a channel per field, named by path.

# elements of an array that become channels of their own: enough for four wheels, too few
# for a picture or a covariance
MAX_ARRAY_CHANNELS = 12
MAX_MESSAGE_DEPTH = 8
# Units by the last but one name of a path, from the definitions of the messages: REP 103,
# sensor_msgs, nav_msgs
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
    """Return the time of measurement in the header of a ROS message, s, or None."""
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
    """Columns of the messages of one topic."""

    type: str
    time: Growing
    columns: dict[str, Growing | None] = field(default_factory=dict)  # None: not needed


class Collector:
    """Collects messages topic by topic. `wanted`: True for needed names; None: all."""

    def __init__(self, path: Path, wanted: Callable[[str], bool] | None = None) -> None:
        self._path, self._wanted = path, wanted
        self._topics: dict[str, _Topic] = {}
        self._messages = 0

    def add(self, topic: str, time: float, message: Any, type_: str = "") -> None:
        """Add one message. The time in its header, if any, replaces `time`.

        Raises
        ------
        UserError
            The file has too many messages for its size.
        """
        self._messages += 1
        if self._messages % CHUNK_ROWS == 0:
            check_rows(self._path, "what is recorded", self._messages, MIN_MESSAGE_BYTES)
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
        """Return the channels by topic and path: /imu.angular_velocity.z."""
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
    """Return the name of a channel."""
    return f"{topic}.{name}" if name else topic


def _find_unit(type_: str, name: str) -> str:
    """Return the unit of a field by the type of its message; "" if it defines none."""
    if not type_.startswith(ROS_TYPES):
        return ""
    parts = name.split(".")
    parent = parts[-2] if len(parts) > 1 else ""
    if parent == "linear" and "Accel" in type_:
        return "m/s2"
    return ROS_UNITS.get(parent, "")
