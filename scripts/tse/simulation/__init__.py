"""Simulate manoeuvres, and a car with the inputs of a log."""
