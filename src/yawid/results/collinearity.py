"""Whether two inputs can be told apart by an estimator that sees a few lags of each.

An aileron that follows the rudder a sample later is as useless beside it as its copy, though the
two hardly correlate. What counts is whether any combination of the lags of one equals one of the
other: the largest canonical correlation of the two sets of lags, or, which says the same, the
condition number of both sets together once each is made orthonormal.
"""

from __future__ import annotations

import math

import numpy as np

from yawid.blocks import Floats

LAGS = 3
"""Lags compared: the default nb, and one for a message that comes a sample later."""
WEAKEST = 1e-3
"""A combination of lags this weak beside the strongest is rounding of the pulses, no movement."""


def closeness(a: Floats, b: Floats) -> float:
    """Return the largest canonical correlation of the lags of ``a`` and ``b`` (n,), 0 if unknown.

    Rows with NaN in any lag are left out.
    """
    lagged = [np.stack([x[i : len(x) - LAGS + 1 + i] for i in range(LAGS)], axis=1) for x in (a, b)]
    rows = np.isfinite(np.concatenate(lagged, axis=1)).all(axis=1)
    if int(rows.sum()) < 10 * LAGS:
        return 0.0
    bases = [_basis(block[rows]) for block in lagged]
    if 0 in (bases[0].shape[1], bases[1].shape[1]):
        return 0.0
    cosines = np.linalg.svd(bases[0].T @ bases[1], compute_uv=False)
    return min(float(cosines[0]), 1.0)


def condition_number(correlation: float) -> float:
    """Return the condition number of two sets of unit columns with that largest correlation."""
    return math.sqrt((1.0 + correlation) / max(1.0 - correlation, 1e-12))


def _basis(columns: Floats) -> Floats:
    """Return an orthonormal basis of what the columns (n, LAGS) do besides standing still."""
    centred = columns - columns.mean(axis=0)
    power, directions = np.linalg.eigh(centred.T @ centred)
    strong = power > max(WEAKEST**2 * float(power[-1]), 1e-12)
    basis: Floats = centred @ directions[:, strong] / np.sqrt(power[strong])
    return basis
