"""Command line of the tse tyre-stiffness estimator: estimate, simulate, report, studies."""

__version__ = "0.1.0"  # the same as include/tse/version.h; a test compares
