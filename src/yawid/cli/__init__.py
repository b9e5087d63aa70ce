"""The command line: arguments become runs, errors become one line and an exit code."""

import os

# This comes before NumPy is loaded. The matrices here are small: on a busy machine several threads
# of its BLAS wait for each other and take fifteen times longer than one (a fit: 225 ms, not 15).
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
