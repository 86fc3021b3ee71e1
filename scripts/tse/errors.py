"""Exceptions of tse. Every message names what is wrong, and what is allowed."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from tse.library.errors import Interrupted, NoFile
from tse.library.errors import UserError as Error

if TYPE_CHECKING:
    from tse.library.core import LearntError, SettingError

__all__ = ["Error", "InputError", "Interrupted", "LearntError", "NoFile", "SettingError"]


class InputError(Error, ValueError):
    """A row that the filter refuses; the filter is as it was before."""

    def __init__(self, text: str, field: str):
        super().__init__(text)
        self.field = field
        """The name of the field that is wrong."""


def __getattr__(name: str) -> Any:
    """Load the exceptions of the C library when they are needed: numpy takes longer than
    --help may."""
    if name not in ("LearntError", "SettingError"):
        raise AttributeError(f"module 'tse.errors' has no attribute {name!r}")
    from tse.library import core

    return getattr(core, name)
