"""Exceptions that users see, and hints at misspelt names."""

from collections.abc import Iterable
from difflib import get_close_matches


class UserError(ValueError):
    """An error in the user's files or options. The message names the place and the cause.

    The command line prints the message without a traceback."""


class NoFile(UserError, FileNotFoundError):
    """A file that the user named does not exist."""

    __str__ = Exception.__str__


class Interrupted(Exception):
    """The user pressed Ctrl-C. The message says how to continue the work."""


def suggest_names(name: str, known: Iterable[str], limit: int = 2, other: str = "") -> str:
    """Return a hint with at most `limit` names from `known` that are similar to `name`.

    If no name is similar, return `other`."""
    close = get_close_matches(name, list(known), limit)
    return f" (did you mean {' or '.join(close)}?)" if close else other
