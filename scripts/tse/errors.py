"""Exceptions of tse. Every message states the error and the allowed values."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from tse.library.errors import Interrupted, NoFile
from tse.library.errors import UserError as Error

if TYPE_CHECKING:
    from tse.library.core import LearntError, SettingError

__all__ = ["Error", "InputError", "Interrupted", "LearntError", "NoFile", "SettingError"]


class InputError(Error, ValueError):
    """The filter refuses a row. The row has not changed the state of the filter."""

    def __init__(self, text: str, field: str):
        super().__init__(text)
        self.field = field
        """Name of the wrong field of the row."""


def __getattr__(name: str) -> Any:
    """Import LearntError and SettingError at their first use. Their module imports numpy,
    which is slow, and `tselab --help` must not wait for it."""
    if name not in ("LearntError", "SettingError"):
        raise AttributeError(f"module 'tse.errors' has no attribute {name!r}")
    from tse.library import core

    return getattr(core, name)
