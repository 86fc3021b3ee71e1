"""Estimate one log (single.py) or many logs of many cars.

find.py finds logs, work.py estimates one, run.py all of them, keep.py stores results,
page.py shows them.
"""
