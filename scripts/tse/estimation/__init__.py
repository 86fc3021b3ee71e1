"""Run the filter over a log, smooth its estimates, and describe them in words.

Terms in this package:
 - answer: the printed result, with one line for each of the three stiffnesses;
 - verdict: states how far the estimate of a stiffness is usable, and why;
 - event: for example a change of the road surface, or a fault of a sensor.
"""
