"""Logs of any format, names, units and rates: read as channels with a time of their own (readers/), named and put into SI units by
signals.toml (signals.py, mapping.py), brought to one raster (raster.py). propose.py guesses signals.toml, and physics.py tests the
guess."""
