"""The kernel as machine code: numba compiles it once per installation, llvmlite loads it."""
