"""A checked log: its channels, clock and units, and the noise of its sensors."""
