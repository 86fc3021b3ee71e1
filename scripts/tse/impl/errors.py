"""What a user may see: each is a standard exception, too."""


class UserError(ValueError):
    """Something in the user's files or options is wrong; the text says what and where. Shown without a traceback."""


class NoFile(UserError, FileNotFoundError):
    """A file that is named is not there."""

    __str__ = Exception.__str__
