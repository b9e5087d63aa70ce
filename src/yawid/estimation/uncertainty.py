"""Whether the residuals are white, from running sums of their products."""

from __future__ import annotations

import numpy as np
from scipy.special import gammaincc

from yawid.blocks import Floats


def ljung_box(products: Floats, s1: float, s2: float) -> float:
    """Return the p-value that the residuals are white (Ljung and Box 1978); NaN while unknown.

    ``products`` (lags + 1,) are sums of eps(k) eps(k-l) with the weights whose sum is ``s1`` and
    whose sum of squares is ``s2``; the sample they make is worth s1^2/s2 values. No degree of
    freedom is taken off: recursive residuals, unlike fitted ones, are white when the model is true.
    """
    lags = len(products) - 1
    if lags < 1 or s1 == 0.0 or not products[0] > 0.0:
        return float("nan")
    n = s1 * s1 / s2
    if n <= lags + 1:
        return float("nan")
    correlation = products[1:] / products[0]
    q = n * (n + 2.0) * float(np.sum(correlation**2 / (n - np.arange(1, lags + 1))))
    return float(gammaincc(0.5 * lags, 0.5 * q))
