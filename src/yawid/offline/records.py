"""Check the input and output of a whole record, once for all batch methods."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from yawid.blocks import Floats
from yawid.errors import ConfigError


def checked_record(u: ArrayLike, y: ArrayLike) -> tuple[Floats, Floats]:
    """Return u (n,) and y (n,) of a record without gaps.

    Raises:
        ConfigError: they differ in length, are not one-dimensional or not finite.
    """
    u, y = np.asarray(u, dtype=np.float64), np.asarray(y, dtype=np.float64)
    if u.ndim != 1 or u.shape != y.shape:
        raise ConfigError(f"u and y must be (n,) alike, got {u.shape} and {y.shape}")
    if not (np.isfinite(u).all() and np.isfinite(y).all()):
        raise ConfigError("u and y must be finite: this method takes a record without gaps")
    return u, y
