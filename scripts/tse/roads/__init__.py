"""Profiles of roads, and matching of logs with roads."""
