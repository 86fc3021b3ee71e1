"""Learnt states: what one drive taught, in a file for the next. The bytes are the library's (tse/learnt.h)."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path

from tse.impl.core import Filter, LearntError
from tse.impl.errors import UserError
from tse.impl.files import atomic

DAY = 86400.0  # s
MOST = 1 << 16  # bytes; no learnt state is longer


@dataclass(frozen=True)
class Learnt:
    """A learnt state, read but not yet checked, and how old it is."""

    path: Path
    data: bytes
    age: float  # s
    given: bool  # the age; else it is that of the file

    def load(self, filter_: Filter) -> None:
        """Let the filter start from it; the library says what is wrong with it."""
        try:
            filter_.load_learnt(self.data, self.age)
        except LearntError as error:
            raise UserError(f"{self.path}: {error}") from None

    @property
    def note(self) -> str:
        days = f"{self.age / DAY:.3g} days"
        return f"{self.path}, {days} old" + (" (--age)" if self.given else " (time of the file; --age says it better)")


def read_learnt(path: Path, age_days: float | None = None) -> Learnt:
    """Read a file that `write_learnt` wrote; without a given age it is as old as the file."""
    try:
        with open(path, "rb") as file:
            data = file.read(MOST)
        age = time.time() - path.stat().st_mtime if age_days is None else age_days * DAY
    except OSError as error:
        raise UserError(f"{path}: cannot be read: {error.strerror}") from None
    return Learnt(path, data, max(age, 0.0), age_days is not None)


def write_learnt(path: Path, data: bytes) -> None:
    with atomic(path, "wb") as file:
        file.write(data)
