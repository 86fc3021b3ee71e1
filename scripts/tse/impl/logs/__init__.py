"""Logs of any format, names, units and rates: read as channels with a time of their own (readers.py chooses among read_*.py, which
share recording.py, table.py, frames.py, fields.py), named and put into SI units by signals.toml (signals.py, mapping.py),
brought to one raster (raster.py). propose.py guesses signals.toml (look.py, wheels.py, scales.py, guesses.py; proposal.py
writes it), and physics.py tests the guess."""
