"""Fit car, sensors and roads together: robust least squares with priors.

Calibration, the calibration on the estimated log, and the first step of `gap` use it.
"""
