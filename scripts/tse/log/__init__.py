"""Rows of a log: channels, checks, clocks, units, and the noise of sensors."""
