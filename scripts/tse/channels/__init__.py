"""Channels of the library from the signals of a log.

Read: signals.toml assigns signals to channels (signals.py, mapping.py). raster.py
resamples them to common rows. log.py returns the log, stream.py the rows of a bus as it
comes.

Propose: proposal.py writes signals.toml from guesses by name, unit and physics (look.py,
wheels.py, scales.py, guesses.py).

Check: agree.py compares the channels with each other, by the relations of physics.py.
"""
