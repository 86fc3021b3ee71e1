"""Room for the columns of very long logs: in a temporary file that the system keeps in memory only while there is enough."""

from __future__ import annotations

import contextlib
import errno
import mmap
import os
import tempfile
from array import array
from collections.abc import Callable, Iterable

import numpy as np

MOST_BYTES = 1 << 20  # of an array that stays in memory: 22 minutes at 100 Hz
MOST_HELD = 1 << 20  # numbers of columns that still grow, all together, that stay in memory: 8 MB
PIECE = 1 << 16  # entries that are read, decoded or resampled at a time: 11 minutes at 100 Hz, 0.5 MB a column
SEGMENT = 1 << 26  # bytes of a file at least: a file descriptor for 64 MB


class Room:
    """Arrays that are too long for memory. They are arrays like any other; let_go() takes none of their values. The files have no
    name, so that nothing is left however the process ends; their content goes with the last array in them.

    OSError: the folder for temporary files is full."""

    def __init__(self) -> None:
        self._maps: list[mmap.mmap] = []
        self._used = 0  # bytes of the last map
        self._growing: list[Growing] = []
        self._held = 0

    def __reduce__(self) -> tuple[type[Room], tuple[()]]:
        """In another process the columns are in memory: they are sent as such."""
        return Room, ()

    def empty(self, rows: int, kind: type = float) -> np.ndarray:
        """An array to be filled, (rows,)."""
        size = rows * np.dtype(kind).itemsize
        if size <= MOST_BYTES:
            return np.empty(rows, kind)
        return self._take(size).view(kind)

    def keep(self, x: np.ndarray) -> np.ndarray:
        """The same values; of a long array not in memory."""
        if x.nbytes <= MOST_BYTES:
            return x
        found = self._take(x.nbytes).view(x.dtype)
        found[:] = x
        return found

    def growing(self) -> Growing:
        """A column whose length nobody knows yet."""
        self._growing.append(Growing(self))
        return self._growing[-1]

    def took(self, count: int) -> None:
        """So many numbers more are in columns that grow."""
        self._held += count
        if self._held > MOST_HELD:
            for each in self._growing:
                each.put_away()
            self._held = 0
            self.let_go()

    def let_go(self) -> None:
        """What was read or written so far need not stay in memory: it is in the file."""
        for each in self._maps:
            if hasattr(mmap, "MADV_DONTNEED"):
                with contextlib.suppress(OSError, ValueError):
                    each.madvise(mmap.MADV_DONTNEED)

    def _take(self, size: int) -> np.ndarray:
        """So many bytes of a file, (size,)."""
        if not self._maps or self._used + size > len(self._maps[-1]):
            with tempfile.TemporaryFile() as file:  # its name is gone at once, its content when nobody uses it
                file.truncate(max(size, SEGMENT))
                if hasattr(
                    os, "posix_fallocate"
                ):  # a disk that is full says so here, not by a signal at the first write
                    try:
                        os.posix_fallocate(file.fileno(), 0, max(size, SEGMENT))
                    except OSError as error:  # some file systems cannot
                        if error.errno not in (errno.EINVAL, errno.EOPNOTSUPP):
                            raise
                self._maps.append(mmap.mmap(file.fileno(), 0))
            self._used = 0
        found = np.frombuffer(self._maps[-1], np.uint8, size, self._used)
        self._used += -(-size // 64) * 64  # numbers of any size stand where processors like them
        return found


class Growing:
    """A column that is filled from its beginning, and then an array."""

    def __init__(self, room: Room):
        self._room = room
        self._parts: list[np.ndarray] = []
        self._stored = 0
        self._last = array("d")

    def __len__(self) -> int:
        return self._stored + len(self._last)

    def extend(self, values: np.ndarray) -> None:
        """More numbers, (entries,)."""
        self._last.frombytes(np.ascontiguousarray(values, float).tobytes())
        self._room.took(len(values))

    def set(self, place: int, value: float) -> None:
        """The number at `place`, which is behind all others; those between are missing. Or again the last one. The caller tells
        Room.took()."""
        if place > len(self):
            self.pad(place)
        if place == len(self):
            self._last.append(value)
        elif self._last:
            self._last[-1] = value
        else:
            self._parts[-1][-1] = value

    def pad(self, length: int) -> None:
        """So many are missing at the end as are needed for this length."""
        while (short := min(length - len(self), PIECE)) > 0:
            self.extend(np.full(short, np.nan))

    def put_away(self) -> None:
        """What is in memory goes into the file."""
        if not self._last:
            return
        values = np.frombuffer(self._last)
        part = self._room._take(values.nbytes).view(float)
        part[:] = values
        self._parts.append(part)
        self._stored += len(values)
        self._last = array("d")

    def array(self) -> np.ndarray:
        """All of it, (entries,). Nothing can be added any more."""
        if self in self._room._growing:
            self._room._growing.remove(self)
            self._room._held -= min(self._room._held, len(self._last))
        if not self._parts:
            return np.frombuffer(self._last).copy() if self._last else np.zeros(0)
        found, done, kept = self._room.empty(len(self)), 0, 0
        for part in (*self._parts, np.frombuffer(self._last) if self._last else np.zeros(0)):
            found[done : done + len(part)] = part
            done += len(part)
            if done - kept > MOST_HELD:
                self._room.let_go()
                kept = done
        self._parts, self._last = [], array("d")
        self._room.let_go()
        return found


class Later:
    """A column that is read when it is needed, in pieces. `rows`: how many it has; `pieces`: reads it, (entries,) at a time."""

    def __init__(self, rows: int, pieces: Callable[[], Iterable[np.ndarray]], room: Room):
        self._rows, self._pieces, self._room = rows, pieces, room
        self._found: np.ndarray | None = None

    def __len__(self) -> int:
        return self._rows

    def read(self) -> np.ndarray:
        """All of it as floats, (rows,)."""
        if self._found is None:
            column = self._room.growing()
            for piece in self._pieces():
                column.extend(piece)
            self._found = column.array()
        return self._found
