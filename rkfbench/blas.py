"""One BLAS thread a process: the arrays are small, cores are used by processes, and sums keep their last bit."""

from __future__ import annotations

import os

VARIABLES = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")


def one_thread() -> None:
    """Ask for one thread here, if NumPy is not imported yet, and in later processes; the user's own wish is kept."""
    for name in VARIABLES:
        os.environ.setdefault(name, "1")
