"""Building, checking and comparing FMUs."""
