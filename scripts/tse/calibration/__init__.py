"""Calibrate a car and its sensors by logs of ordinary driving."""
