"""What a car, its sensors and its roads are, from logs: one fit, robust least squares
with the priors of cars and roads, which `tselab calibrate`, the calibration on the log
itself and the first step of `tselab gap` share."""
