"""What the API and the command stand on."""

__version__ = "0.2.0"  # the same as include/tse/version.h; a test compares
