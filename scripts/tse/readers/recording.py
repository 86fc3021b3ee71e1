"""What every reader gives: channels with their own time, unit and name, as they are in the file."""

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
except ImportError:  # Windows has none
    resource = None

MAX_LISTED_NAMES = 6  # names that one message lists
CHUNK_ROWS = 1 << 16  # frames and rows of text that are decoded at a time


RECEIVER_TEXT = "receiver of GNSS"  # what is said about a channel of one


_ABBREVIATED = re.compile(r"(?<=[A-Za-z])\.(?=_|$)")


def last_part(name: str) -> str:
    """Return the last part of a path of names. A point that ends a word is none of the path: Lat._Vel."""
    return re.split(r"[./]", _ABBREVIATED.sub("", name))[-1]


@dataclass(frozen=True)
class Channel:
    """One signal of a log. `time`, s, and `value` have one entry per sample; NaN: missing. Channels of one message or table share
    the array `time`. Nothing is assumed of the time: reader and file are as they are, clock.py puts it right."""

    name: str
    time: np.ndarray
    value: np.ndarray
    unit: str = ""  # as the file says it; "": it does not
    text: str = ""  # what the file says about it
    states: Mapping[float, str] = field(default_factory=dict)  # what single values mean, as a database has it

    @property
    def short(self) -> str:
        """The name without its message, group or topic."""
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
                f"{source}: {name!r} is in {self.path.name} {len(alike)} times: say which: {list_names(c.name for c in alike)}"
            )
        raise UserError(
            f"{source}: there is no {name!r} in {self.path.name}{suggest_channels(name, self.channels)}"
        )

    def has(self, name: str) -> bool:
        """Would find() find it?"""
        return (
            name in self.channels
            or sum(c.short == name or c.name.endswith((f".{name}", f"/{name}")) for c in self) == 1
        )

    def since_start(self) -> Recording:
        """Times counted from the first sample: an epoch in a double leaves less than a microsecond."""
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


# ---- Columns that a file gives piece by piece.


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


# ---- What a file may take. Compressed, it says of itself how much there is, and may be made to fill the machine.

ALWAYS_ALLOWED_ROWS = 1_500_000  # that any log may have: four hours at 100 Hz
MIN_SIGNAL_BYTES, MIN_ROW_BYTES, MIN_FRAME_BYTES, MIN_MESSAGE_BYTES = (
    2,
    5,
    4,
    8,
)  # bytes of the file, at least: for a value of a signal, a row of all, a frame, a message
MEMORY_LIMIT_VARIABLE = "TSE_HOLD_MEMORY"  # of the environment
BASE_MEMORY, MEMORY_PER_BYTE = (
    700 << 20,
    16,
)  # bytes of memory for what is read of any file, and more for each byte of it


def measure_size(path: Path) -> int:
    """Bytes of a file, or of all in a folder."""
    return (
        sum(p.stat().st_size for p in path.rglob("*") if p.is_file())
        if path.is_dir()
        else path.stat().st_size
    )


def check_rows(path: Path, what: str, rows: int, each: int = MIN_SIGNAL_BYTES) -> None:
    """Before it is unpacked. UserError: a row has less than `each` bytes of the file, and there are more than any log may have."""
    most = (
        max(ALWAYS_ALLOWED_ROWS, measure_size(path) // each)
        if rows > ALWAYS_ALLOWED_ROWS
        else ALWAYS_ALLOWED_ROWS
    )
    if rows > most:
        raise UserError(
            f"{path}: {what} has {rows:,} rows; of a file of its size up to {most:,} are read (four hours at 100 Hz of any): cut "
            "it into drives; or it is made to fill the machine"
        )


MAX_COLUMNS = 20_000  # of a table; the largest of public logs has 3 000
MAX_NAME_LENGTH = 1000  # characters


def check_columns(path: Path, names: Collection[str]) -> None:
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
        There are more than MOST_COLUMNS, or a name is longer than LONGEST_NAME.
    """
    if len(names) > MAX_COLUMNS:
        raise UserError(
            f"{path}: has {len(names):,} columns; up to {MAX_COLUMNS:,} are read: leave out those that are not needed"
        )
    long = next((n for n in names if len(n) > MAX_NAME_LENGTH), None)
    if long is not None:
        raise UserError(
            f"{path}: the name of a column has {len(long):,} characters ({long[:30]!r} ...); up to {MAX_NAME_LENGTH:,} are read"
        )


@contextmanager
def limit_memory(path: Path) -> Iterator[None]:
    """Hold the process to the memory that reading the file may take, where the system can (Linux) and HOLD is set, which commands
    set for themselves and their workers: other work of a process would be held to it, too. UserError: it takes more."""
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
            f"{path}: takes more than {room / 2**30:.1f} GB of memory to read, which is far more than its size: it is damaged, "
            "made to fill the machine, or very long: cut it into drives"
        ) from None
    finally:
        resource.setrlimit(resource.RLIMIT_DATA, before)


BASE_READ_TIME, READ_TIME_PER_MB = (
    30.0,
    3.0,
)  # s of processor that reading any file may take, and more for each MB of it


class _TookLong(BaseException):
    """Raised inside readers of others, which catch every Exception."""


@contextmanager
def limit_time(path: Path) -> Iterator[None]:
    """Hold the reading of a file to a time of the processor, where the system can.

    Parameters
    ----------
    path : Path
        The file. Its size says how long it may take.

    Raises
    ------
    UserError
        It takes longer: its blocks lead in a circle, or it is made to.

    Notes
    -----
    Signals reach the main thread alone. In others, and on Windows, a thread beside it watches; it cannot stop a library that
    does not come back to Python. The innermost of several blocks leaves the limit to the outermost.
    """
    most = BASE_READ_TIME + READ_TIME_PER_MB * measure_size(path) / 2**20 if path.exists() else 0.0
    alone = hasattr(signal, "setitimer") and threading.current_thread() is threading.main_thread()
    if not alone and most and not getattr(_THREAD, "watched", False):
        with _watch_thread(path, most):
            yield
        return
    if not alone or not most or signal.getitimer(signal.ITIMER_VIRTUAL)[0] > 0:
        yield
        return

    def stop(*_: object) -> None:
        raise _TookLong

    before = signal.signal(signal.SIGVTALRM, stop)
    signal.setitimer(signal.ITIMER_VIRTUAL, most, 1.0)  # again each second: a reader may have caught it
    try:
        yield
    except _TookLong as error:
        _release_frames(error)
        raise _make_time_error(path, most) from None
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0.0)
        signal.signal(signal.SIGVTALRM, before)


def _make_time_error(path: Path, most: float) -> UserError:
    return UserError(
        f"{path}: takes more than {most:.0f} s to read, which is far more than its size: its blocks lead in a circle, or it is "
        "made to keep a machine busy"
    )


_THREAD = threading.local()  # watched: somebody watches this thread


def _measure_work(ident: int) -> float:
    """Return how long a thread has worked, s; where the system does not say, a clock."""
    try:
        return time.clock_gettime(time.pthread_getcpuclockid(ident))
    except (AttributeError, OSError):
        return time.monotonic()


@contextmanager
def _watch_thread(path: Path, most: float) -> Iterator[None]:
    """The same as in_time() for a thread that no signal reaches: another one watches it, and interrupts it."""
    ident, ended = threading.get_ident(), threading.Event()
    begin, interrupt = _measure_work(ident), ctypes.pythonapi.PyThreadState_SetAsyncExc

    def watch() -> None:
        while not ended.wait(min(1.0, most)):
            if _measure_work(ident) - begin > most:
                interrupt(
                    ctypes.c_ulong(ident), ctypes.py_object(_TookLong)
                )  # again each second: a reader may have caught it

    watcher = threading.Thread(target=watch, daemon=True, name="watchdog of a reader")
    _THREAD.watched = True
    watcher.start()
    try:
        try:
            yield
        finally:
            _THREAD.watched = False
            ended.set()
            watcher.join()
            interrupt(ctypes.c_ulong(ident), None)  # one that has not come yet comes no more
    except _TookLong as error:
        _release_frames(error)
        raise _make_time_error(path, most) from None


def _release_frames(error: BaseException) -> None:
    """Let go of what a reader had opened, without what it complains of on its way out."""
    hook = sys.unraisablehook
    sys.unraisablehook = lambda _: None
    try:
        traceback.clear_frames(error.__traceback__)
        error.__traceback__ = error.__context__ = None
        gc.collect()
    finally:
        sys.unraisablehook = hook


MAX_CELL_LENGTH = 1 << 16  # characters
csv.field_size_limit(
    1 << 22
)  # more than is ever looked at: a separator that is tried makes one cell of a whole line


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
        What stands between cells.
    blanks : bool
        Whether blanks behind the separator are skipped.
    tried : bool
        Whether the separator is only tried: a long cell is no fault then.

    Returns
    -------
    list of str
        Empty of an empty line.

    Raises
    ------
    UserError
        A cell is longer than any of a log.
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
            f"{path}: a cell has {len(long):,} characters; up to {MAX_CELL_LENGTH:,} are read: {long[:30]!r} ..."
        )
    return cells


def _read_data_size() -> int | None:
    """Bytes that the process holds; None: the system does not say."""
    if resource is None:
        return None
    try:
        said = re.search(r"VmData:\s+(\d+) kB", Path("/proc/self/status").read_text(encoding="ascii"))
    except OSError:
        return None
    return int(said[1]) << 10 if said else None


@dataclass(frozen=True)
class ReadOptions:
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


def find_unused_name(name: str, taken: Container[str]) -> str:
    """A name that none has: the second of it is NAME#2."""
    return next(n for k in itertools.count(1) if (n := f"{name}#{k}" if k > 1 else name) not in taken)


def suggest_channels(name: str, known: Iterable[str]) -> str:
    """A hint for a name that is not there."""
    known = list(known)
    lower = {k.lower(): k for k in known}
    short = {k.replace("/", ".").rpartition(".")[2].lower(): k for k in known}
    found = get_close_matches(name.lower(), [*lower, *short], 3, 0.6)
    if found:
        return f" (did you mean {list_names(dict.fromkeys(lower.get(f) or short[f] for f in found))}?)"
    return f"; it has {list_names(known)}; 'tselab signals LOG' lists them"


def list_names(names: Iterable[str]) -> str:
    """Some names, and how many more."""
    names = list(names)
    more = len(names) - MAX_LISTED_NAMES
    return ", ".join(names[:MAX_LISTED_NAMES]) + (f" and {more} more" if more > 0 else "")


# ---- Libraries that are optional: what is not installed is named with the command that installs it.


def import_optional(module: str, extra: str, what: str) -> ModuleType:
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


# ---- Messages into channels by the path of their fields: what ROS, MCAP, JSON and Cap'n Proto have in common.

# elements of an array that become channels of their own: enough for four wheels, too few
# for a picture or a covariance
MAX_ARRAY_CHANNELS = 12
MAX_MESSAGE_DEPTH = 8
# Units by the definitions of the messages, by the last two fields of a path: REP 103, sensor_msgs, nav_msgs
SI = {"angular_velocity": "rad/s", "linear_acceleration": "m/s2", "linear": "m/s", "angular": "rad/s"}
ROS_TYPES = ("sensor_msgs", "geometry_msgs", "nav_msgs")


def flatten_message(message: Any, at: str = "", depth: int = 0) -> Iterator[tuple[str, float]]:
    """Numbers of a message with their paths: angular_velocity.z, wheels.0."""
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
    """Time of measurement in the header of a ROS message, s; None where there is none, or it is 0."""
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
    type: str
    time: Growing
    columns: dict[str, Growing | None] = field(default_factory=dict)  # None: not wanted


class Collector:
    """Collects messages topic by topic, and makes channels of them. `wanted`: which names are needed; None: all."""

    def __init__(self, path: Path, wanted: Callable[[str], bool] | None = None) -> None:
        self._path, self._wanted = path, wanted
        self._topics: dict[str, _Topic] = {}
        self._messages = 0

    def add(self, topic: str, time: float, message: Any, type_: str = "") -> None:
        """One message. Its time is that of its header, where it has one. UserError: more than such a file holds."""
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
        """By topic and path: /imu.angular_velocity.z."""
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
    return f"{topic}.{name}" if name else topic


def _find_unit(type_: str, name: str) -> str:
    if not type_.startswith(ROS_TYPES):
        return ""
    parts = name.split(".")
    parent = parts[-2] if len(parts) > 1 else ""
    if parent == "linear" and ("Accel" in type_):
        return "m/s2"
    return SI.get(parent, "")
