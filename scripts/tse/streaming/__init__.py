"""Estimate while driving: drive.py reads the CAN bus, runs the filter and records the
drive, page.py serves a web page with plots of the estimates."""
