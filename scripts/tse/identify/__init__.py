"""Fit car, sensors and roads together by robust least squares with priors.

Used by `tselab calibrate`, by `tselab estimate` if it first calibrates the car on the log
itself, and by the first step of `tselab gap`.
"""
