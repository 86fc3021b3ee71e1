"""Files of results, for commands that are built on tse: refuse early what cannot be
written, and write a file completely or not at all."""

from __future__ import annotations

from tse.library.files import (
    alone,
    atomic,
    check_directory,
    check_distinct,
    check_writable,
    is_parquet,
    make_directory,
    no_room,
    real,
)

__all__ = [
    "alone",
    "atomic",
    "check_directory",
    "check_distinct",
    "check_writable",
    "is_parquet",
    "make_directory",
    "no_room",
    "real",
]
