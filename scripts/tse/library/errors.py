"""What a user may see: each is a standard exception, too; and what may have been meant by a name that is not known."""

from collections.abc import Iterable
from difflib import get_close_matches


class UserError(ValueError):
    """Something in the user's files or options is wrong; the text says what and where. Shown without a traceback."""


class NoFile(UserError, FileNotFoundError):
    """A file that is named is not there."""

    __str__ = Exception.__str__


class Interrupted(Exception):
    """Ctrl-C; the text says how to go on."""


def suggest_names(name: str, known: Iterable[str], most: int = 2, other: str = "") -> str:
    """Return a hint for a name that is not known; `other` where none is like it."""
    close = get_close_matches(name, list(known), most)
    return f" (did you mean {' or '.join(close)}?)" if close else other
