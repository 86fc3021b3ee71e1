"""What the API refuses. Every message names what is wrong, and what is allowed."""

from __future__ import annotations

from tse.library.core import LearntError, SettingError
from tse.library.errors import UserError as Error

__all__ = ["Error", "InputError", "LearntError", "SettingError"]


class InputError(Error, ValueError):
    """A row that the filter refuses; the filter is as it was before."""

    def __init__(self, text: str, field: str):
        super().__init__(text)
        self.field = field
        """The name of the field that is wrong."""
