"""The poles of samples by least squares: an answer without an estimator of the project."""

from __future__ import annotations

import math

import numpy as np


def poles_of(
    u: np.ndarray, y: np.ndarray, nb: int, sample_time_s: float
) -> tuple[float, float, np.ndarray]:
    """Return wn, zeta and theta of the ARX(2, nb, 1) model of u and y (n,)."""
    columns = [-np.roll(y, 1), -np.roll(y, 2), *(np.roll(u, 1 + i) for i in range(nb))]
    phi = np.stack(columns, axis=1)[max(2, nb) :]
    theta = np.linalg.lstsq(phi, y[max(2, nb) :], rcond=None)[0]
    s = np.log(np.roots([1.0, *theta[:2]]).astype(complex)) / sample_time_s
    wn = math.sqrt(abs(s[0] * s[1]))
    return wn, -(s[0] + s[1]).real / 2.0 / wn, theta
