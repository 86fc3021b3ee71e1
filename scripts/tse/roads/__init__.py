"""Profiles of roads, and where on a road each row of a log is."""
