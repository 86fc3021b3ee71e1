"""The one exception a user may see."""


class UserError(Exception):
    """Something in the user's files or options is wrong; the text says what and where. Shown without a traceback."""
