"""`tselab live`: the filter while driving. drive.py reads the bus, runs the filter and records; page.py shows it in a browser."""
