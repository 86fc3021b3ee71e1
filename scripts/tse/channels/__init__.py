"""Make the channels of the library from the signals of a log.

Read: signals.toml assigns signals to channels (signals.py, mapping.py). raster.py
resamples the channels to common rows. log.py returns the rows of a whole log, stream.py
the rows of a bus while its frames arrive.

Propose: proposal.py writes signals.toml. look.py, wheels.py, scales.py and guesses.py
find the signals by name, unit and physics.

Check: agree.py compares the channels with each other, by the relations of physics.py.
"""
