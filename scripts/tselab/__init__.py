"""Command line of the tse tyre-stiffness estimator. Each command calls the public API
`tse` and prints the result."""

import os
import sys

# Let OpenBLAS run with one thread. The matrices of tse are so small that more threads
# cost more time than they save, and --jobs already runs several processes. OpenBLAS reads
# OPENBLAS_NUM_THREADS when NumPy is imported. If a program has already imported tse,
# NumPy may have been imported, too, and the variable is not changed.
if "tse" not in sys.modules:
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from tse import __version__ as __version__
