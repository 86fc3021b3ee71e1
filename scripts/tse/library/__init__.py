"""The binding of the C library, files that are written completely, processes, and errors for users."""

__version__ = "0.2.0"  # the same as include/tse/version.h; a test compares
