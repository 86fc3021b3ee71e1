"""Logs of any format, names, units and rates: read as channels with a time of their own (readers.py chooses among read_*.py, which
share recording.py, table.py), named and put into SI units by signals.toml (signals.py, mapping.py),
brought to one raster (raster.py). proposal.py guesses and writes signals.toml (look.py, wheels.py, scales.py, guesses.py), and
physics.py tests the guess."""
