"""Command line of the tse tyre-stiffness estimator: estimate, simulate, report, studies."""

import os

# Matrices here are small: threads of the linear algebra cost more than they save, and --jobs are our own. Before NumPy is loaded.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

__version__ = "0.1.0"  # the same as include/tse/version.h; a test compares
