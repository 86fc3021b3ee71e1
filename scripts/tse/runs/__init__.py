"""Estimate one log (single.py), or a fleet, which is many logs of many cars.

For a fleet, find.py finds the logs, run.py distributes them to processes, work.py
estimates one log in a process, keep.py stores the results, and page.py writes the HTML
page.
"""
