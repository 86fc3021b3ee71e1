"""Readers of log formats: readers.py chooses a read_*.py, which returns a Recording."""
