"""Functions for commands that write results: check before a long run that a file can be
written, and write each file completely or not at all."""

from __future__ import annotations

from tse.library.files import (
    check_directory,
    check_distinct,
    check_writable,
    explain_write_error,
    is_parquet,
    lock_file,
    make_directory,
    resolve_path,
    write_atomically,
)

__all__ = [
    "check_directory",
    "check_distinct",
    "check_writable",
    "explain_write_error",
    "is_parquet",
    "lock_file",
    "make_directory",
    "resolve_path",
    "write_atomically",
]
