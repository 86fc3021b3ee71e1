"""Estimate one log (single.py), or a fleet: many logs of many cars.

For a fleet, find.py finds the logs, work.py estimates one log, run.py runs all of them,
keep.py stores the results, and page.py writes the page.
"""
