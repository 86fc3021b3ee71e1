"""Command line of the tse tyre-stiffness estimator: estimate, simulate, report, studies."""

import os
import sys

# Matrices here are small: threads of the linear algebra cost more than they save, and --jobs are our own. Before NumPy is loaded.
# Who imports tse has a program of his own, which decides for itself.
if "tse" not in sys.modules:
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from tse.library import __version__ as __version__
