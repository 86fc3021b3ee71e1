"""What a car and its sensors are, from logs: simulation error under priors, with a discrepancy of each channel that no model
explains. One engine: calibration asks it for the car and its sensors."""
