"""Tests whether residuals are white, from sums of their products."""

import math

import numpy as np

from yawid.blocks import Floats


def ljung_box(products: Floats, s1: float, s2: float) -> float:
    """Return the p-value of the hypothesis of white residuals (Ljung and Box 1978); NaN if unknown.

    ``products`` (lags + 1,) are weighted sums of eps(k) eps(k-l); the sum of the weights is ``s1``
    and that of their squares ``s2``, so that they count as s1^2/s2 values. No degrees of freedom
    are subtracted: recursive residuals, unlike those of a fit, are white where the model is true.
    """
    lags = len(products) - 1
    if lags < 1 or s1 == 0.0 or not products[0] > 0.0:
        return float("nan")
    n = s1 * s1 / s2
    if n <= lags + 1:
        return float("nan")
    correlation = products[1:] / products[0]
    q = n * (n + 2.0) * float(np.sum(correlation**2 / (n - np.arange(1, lags + 1))))
    return chi_square_tail(q, lags)


def chi_square_tail(q: float, degrees: int) -> float:
    """Return the probability that chi-square with ``degrees`` of freedom, at least 1, exceeds q.

    It is the regularised incomplete gamma function Q(degrees/2, q/2), by the recurrence
    Q(s+1, x) = Q(s, x) + x^s e^-x / Gamma(s+1) from Q(1, x) or Q(1/2, x); all terms are positive.
    """
    x = 0.5 * q
    if not 0.0 < x < math.inf:
        return 1.0 if x == 0.0 else 0.0 if x > 0.0 else math.nan
    even = degrees % 2 == 0
    s, tail = (1.0, math.exp(-x)) if even else (0.5, math.erfc(math.sqrt(x)))
    while s < 0.5 * degrees:
        tail += math.exp(s * math.log(x) - x - math.lgamma(s + 1.0))
        s += 1.0
    return tail
