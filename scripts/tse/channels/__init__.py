"""Make the channels of the library from the signals of a log.

A signal is a quantity with the name and the unit that it has in the log. A channel is a
quantity with the name and the SI unit that it has in the library, e.g. yaw_rate in rad/s.

Read: The file signals.toml assigns signals to channels (signals.py, mapping.py).
raster.py resamples the channels to common rows. log.py returns the rows of a whole log,
stream.py the rows of a bus while its frames arrive.

Propose: proposal.py writes signals.toml. look.py, wheels.py, scales.py and guesses.py
find the signals by name, unit and physics.

Check: agree.py compares the channels with each other, by the relations of physics.py.
"""
