"""`tselab calibrate`: what the car and the sensors of a log are, found from ordinary driving."""
