"""Where simulation and measurement disagree, what of that is left after naming, and what the logs excite at all."""
