"""Command line of the tse tyre-stiffness estimator. It calls the public API `tse`, and
prints its results."""

import os
import sys

# Matrices are small here: threads of the linear algebra cost more than they save, and
# --jobs runs processes. Set before NumPy is loaded. A program that has imported tse
# decides for itself.
if "tse" not in sys.modules:
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from tse import __version__ as __version__
