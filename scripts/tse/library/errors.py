"""Exceptions for users, and hints for misspelt names."""

from collections.abc import Iterable
from difflib import get_close_matches


class UserError(ValueError):
    """An error in the user's files or options. The text names the place and the cause.

    The command shows it without a traceback."""


class NoFile(UserError, FileNotFoundError):
    """A named file does not exist."""

    __str__ = Exception.__str__


class Interrupted(Exception):
    """Ctrl-C. The text tells how to continue the work."""


def suggest_names(name: str, known: Iterable[str], most: int = 2, other: str = "") -> str:
    """Return a hint with up to `most` similar known names; `other` if none is similar."""
    close = get_close_matches(name, list(known), most)
    return f" (did you mean {' or '.join(close)}?)" if close else other
