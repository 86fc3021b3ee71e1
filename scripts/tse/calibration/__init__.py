"""Calibrate a car and its sensors on logs of ordinary driving."""
