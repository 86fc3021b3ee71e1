"""Binding of the C library, atomic writing of files, worker processes, user errors."""

__version__ = "0.2.0"  # equal to the version in include/tse/version.h, as a test checks
