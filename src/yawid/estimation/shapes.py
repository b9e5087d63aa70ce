"""Check what the caller hands over, before anything is touched."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from yawid.blocks import Floats


def checked_u(u: ArrayLike, y: float, n_inputs: int) -> Floats:
    """Return one sample's inputs (n_inputs,).

    Raises:
        ValueError: another number of inputs, or an infinite value.
    """
    row = np.atleast_1d(np.asarray(u if u is not None else (), dtype=np.float64))
    if row.shape != (n_inputs,):
        raise ValueError(f"u must hold {n_inputs} inputs, got shape {np.shape(u)}")
    if np.isinf(row).any() or np.isinf(y):
        raise ValueError(f"u and y must not be infinite, got u = {u!r}, y = {y!r}")
    return row


def checked_samples(u: ArrayLike, y: ArrayLike, n_inputs: int) -> tuple[Floats, Floats]:
    """Return u (samples, n_inputs) and y (samples,), contiguous.

    Raises:
        ValueError: wrong shapes.
    """
    y = np.ascontiguousarray(y, np.float64)
    if y.ndim != 1:
        raise ValueError(f"y must have shape (samples,), got {y.shape}")
    n = len(y)
    u = np.ascontiguousarray(u if u is not None else np.empty((n, 0)), np.float64)
    if u.ndim == 1 and n_inputs == 1:
        u = u[:, np.newaxis]
    if u.shape != (n, n_inputs):
        raise ValueError(f"u must have shape ({n}, {n_inputs}), got {u.shape}")
    return u, y
