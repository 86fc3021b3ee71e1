"""Simulate manoeuvres, and the car of a file along a log."""
