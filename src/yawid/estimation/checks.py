"""Checks of the arrays that a caller passes, made before anything changes."""

import numpy as np
from numpy.typing import ArrayLike

from yawid.blocks import Floats
from yawid.errors import ConfigError


def checked_samples(
    u: ArrayLike, y: ArrayLike, n_inputs: int, *, finite_or_nan: bool = False
) -> tuple[Floats, Floats]:
    """Return u (samples, n_inputs) and y (samples,), contiguous; NaN marks a missing sample.

    Raises:
        ConfigError: a shape is wrong or, with ``finite_or_nan``, a value is infinite.
    """
    y = np.ascontiguousarray(y, np.float64)
    if y.ndim != 1:
        raise ConfigError(f"y must have shape (samples,), got {y.shape}")
    n = len(y)
    u = np.ascontiguousarray(u if u is not None else np.empty((n, 0)), np.float64)
    if u.ndim == 1 and 1 in (n, n_inputs) and len(u) == n * n_inputs:  # of one sample or input
        u = u.reshape(n, n_inputs)
    if u.shape != (n, n_inputs):
        raise ConfigError(f"u must have shape ({n}, {n_inputs}), got {u.shape}")
    if finite_or_nan and (np.isinf(u).any() or np.isinf(y).any()):
        raise ConfigError("u and y must not be infinite; a NaN marks a sample to be left out")
    return u, y
