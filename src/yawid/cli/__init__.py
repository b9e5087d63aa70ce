"""Arguments to runs, errors to one line and an exit code."""

import os

# Before NumPy is loaded. The matrices here are small: on a busy machine the threads of its BLAS
# wait for each other fifteen times longer than one alone takes (a fit: 225 ms for 15).
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
