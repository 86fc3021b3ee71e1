"""Fit car, sensors and roads together by robust least squares with priors.

Used by `tselab calibrate`, by the calibration on the log that is estimated, and by the
first step of `tselab gap`.
"""
