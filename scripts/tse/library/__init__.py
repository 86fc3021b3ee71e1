"""Binding of the C library, complete writing of files, processes, errors for users."""

__version__ = "0.2.0"  # the same as include/tse/version.h; a test compares
