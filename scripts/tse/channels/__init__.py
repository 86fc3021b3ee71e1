"""Channels of the library from the signals of a log.

signals.toml names signals (signals.py, mapping.py), raster.py brings them to common times, log.py returns
rows. proposal.py guesses and writes signals.toml (look.py, wheels.py, scales.py, guesses.py). physics.py
and agree.py test whether channels agree.
"""
