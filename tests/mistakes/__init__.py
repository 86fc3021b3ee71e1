"""Logs with a mistake in them, through everything that takes a log."""
