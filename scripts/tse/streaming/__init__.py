"""Estimate while driving: drive.py reads the bus, runs the filter and records; page.py
shows."""
