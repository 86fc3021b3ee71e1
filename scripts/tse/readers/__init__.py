"""Readers of log formats. readers.py chooses among read_*.py; each returns a Recording (recording.py)."""
