"""The kernel as machine code: compiled by numba once per installation, loaded by llvmlite alone."""
