"""Command line of the tse tyre-stiffness estimator. Each command calls the public API
`tse` and prints the result."""

import os
import sys

# OpenBLAS runs with one thread: for the small matrices of tse, threads cost more time
# than they save, and --jobs already runs processes. The variable is read when NumPy is
# imported. If a program has already imported tse, it is left as it is.
if "tse" not in sys.modules:
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from tse import __version__ as __version__
