"""Find car, sensors and roads in one fit: robust least squares with priors.

Shared by calibration, by the calibration on the log that is estimated, and by the first step of `gap`.
"""
