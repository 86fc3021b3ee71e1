"""What no effect of the catalogue explains, as a formula: proposed, fitted, judged."""
