"""Checks of the arrays that a caller passes, made before anything changes."""

import numpy as np
from numpy.typing import ArrayLike

from yawid.blocks import Floats
from yawid.errors import ConfigError


def checked_u(u: ArrayLike, y: float, n_inputs: int) -> Floats:
    """Return one sample's inputs (n_inputs,) from ``u``, which is a float or (n_inputs,).

    Raises:
        ConfigError: the number of inputs is wrong, or u or y is infinite.
    """
    row = np.atleast_1d(np.asarray(u if u is not None else (), dtype=np.float64))
    if row.shape != (n_inputs,):
        raise ConfigError(f"u must hold {n_inputs} inputs, got shape {np.shape(u)}")
    if np.isinf(row).any() or np.isinf(y):
        raise ConfigError(f"u and y must not be infinite, got u = {u!r}, y = {y!r}")
    return row


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
    if u.ndim == 1 and n_inputs == 1:
        u = u[:, np.newaxis]
    if u.shape != (n, n_inputs):
        raise ConfigError(f"u must have shape ({n}, {n_inputs}), got {u.shape}")
    if finite_or_nan and (np.isinf(u).any() or np.isinf(y).any()):
        raise ConfigError("u and y must not be infinite; a NaN marks a sample to be left out")
    return u, y
