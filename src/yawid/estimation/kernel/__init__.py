"""The recursion in plain Python, which numba compiles: private to the estimators."""
