"""Infer what is missing in a model of a car: sets of effects, judged by their evidence,
or a formula if no effect of the catalogue explains the logs. Held-out logs test both.
"""
