"""Run the filter over a log, smooth its estimates, and describe them in words.

The answer is the printed result: one line for each of the three stiffnesses. A verdict
states how far a stiffness is usable, and why. An event is e.g. a change of the road or a
fault of a sensor.
"""
