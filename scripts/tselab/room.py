"""Room for the columns of very long logs: in a temporary file that the system keeps in memory only while there is enough."""

from __future__ import annotations

import contextlib
import mmap
import tempfile
from collections.abc import Sequence

import numpy as np

MOST_ROWS = 1 << 20  # that are kept in memory: 3 hours at 100 Hz, 60 MB


class Room:
    """Columns of numbers, (rows,), to be filled. They are arrays like any other; let_go() takes none of their values."""

    def __init__(self, names: Sequence[str], rows: int):
        self._map: mmap.mmap | None = None
        if rows <= MOST_ROWS:
            self.column = {name: np.empty(rows) for name in names}
            return
        with tempfile.TemporaryFile() as file:  # its name is gone at once, its content when nobody uses it
            file.truncate(8 * len(names) * rows)
            self._map = mmap.mmap(file.fileno(), 0)
        whole = np.frombuffer(self._map, np.float64).reshape(len(names), rows)
        self.column = dict(zip(names, whole, strict=True))

    def __reduce__(self) -> tuple[type[Room], tuple[tuple[()], int]]:
        """In another process the columns are in memory: they are sent as such."""
        return Room, ((), 0)

    def take(self) -> dict[str, np.ndarray]:
        """The columns, which are the caller's from now on."""
        column, self.column = self.column, {}
        return column

    def let_go(self) -> None:
        """What was read or written so far need not stay in memory: it is in the file."""
        if self._map is not None and hasattr(mmap, "MADV_DONTNEED"):
            with contextlib.suppress(OSError, ValueError):
                self._map.madvise(mmap.MADV_DONTNEED)
