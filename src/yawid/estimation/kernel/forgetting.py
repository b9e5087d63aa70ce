"""What surrounds each update: forgetting, drift, the information floor, the running sums."""

# numba infers the types: float64 arrays and floats.
# mypy: disable-error-code="no-untyped-def, no-untyped-call"
from __future__ import annotations

import math

from yawid.estimation.kernel.linear_algebra import correlate, drift_entry, floor, hot, jit, p_entry
from yawid.estimation.kernel.state import (
    BEST,
    COVARIANCE,
    DIVERGED,
    DRIFT,
    DRIFTS,
    E2,
    EPS2,
    FAST,
    FAST_E2,
    FAST_FALL,
    FAST_Y2,
    FLOOR,
    GAIN,
    LAGS,
    LAMBDA,
    LAMBDA_END,
    LAMBDA_RATE,
    LEAST,
    LOSS,
    MOST_RISE,
    NEXT,
    PRODUCTS,
    RESIDUALS,
    S1,
    S2,
    SCRATCH,
    SETTLING,
    SINCE,
    SLACK,
    SLOW_RISE,
    UPDATES,
    UPPER,
    WARM,
    Y2,
    D,
    N,
)


@hot
def _keep_information(s, at, d, upper):
    """Keep the floor under what is known of one parameter, the next at each update.

    P[k, k] may exceed its usual least by the share SLACK / FLOOR; beyond, a row "theta[k] is what
    it is", just heavy enough, brings it back. The usual least falls fast and rises over many
    memories, no further than to MOST_RISE times the best there was, so that neither poverty, be it
    days of it, nor one wild sample sets it. While the signals excite, no row
    is added: rows of a fixed weight outweigh the little that quiet noise says of C.
    """
    gain = at[GAIN]
    least = at[LEAST]
    best = at[BEST]
    k, n = int(s[NEXT]), len(d)
    s[NEXT] = 0.0 if k + 1 == n else k + 1.0
    p = p_entry(d, upper, k, k)
    if p >= least[k]:
        rise = 1.0 + SLOW_RISE * n * (1.0 - s[LAMBDA_END])
        least[k] = min(least[k] * rise, MOST_RISE * best[k])
    else:
        least[k] = p if s[SINCE] < SETTLING else max(p, FAST_FALL * least[k])
        best[k] = min(best[k], least[k])
    limit = least[k] * (1.0 + SLACK / s[FLOOR])
    if p > limit:
        floor(d, upper, k, 1.0 / limit - 1.0 / p, gain)


@jit
def noise_variance(s):
    """Return the variance of the innovation on scaled signals; NaN before the first update."""
    if s[S1] == 0.0:
        return math.nan
    return s[LOSS] / max(s[S1] - s[N] * s[S2] / s[S1], 1.0)


@hot
def adapt(s, at, lam):
    """Let P grow by forgetting or drift, no further than its cap, and keep information in it."""
    d = at[D]
    upper = at[UPPER]
    drift = at[DRIFT]
    scratch = at[SCRATCH]
    covariance = at[COVARIANCE]
    n = len(d)
    if s[DRIFTS] > 0.0:
        for i in range(n):
            if drift[i] > 0.0:
                drift_entry(d, upper, i, drift[i], scratch)
                if s[LAGS] > 0.0:
                    covariance[i * n + i] += drift[i] * noise_variance(s) if s[S1] > 0.0 else 0.0
    if s[FLOOR] > 0.0:
        _keep_information(s, at, d, upper)
    s[LAMBDA] = s[LAMBDA_RATE] * lam + (1.0 - s[LAMBDA_RATE]) * s[LAMBDA_END]


@hot
def account(s, at, y, e, eps, lam, share):
    """Keep the running sums, and test for divergence: y_hat much worse than none at all."""
    residuals = at[RESIDUALS]
    products = at[PRODUCTS]
    s[S1] = lam * s[S1] + 1.0
    s[S2] = lam * lam * s[S2] + 1.0
    s[LOSS] = lam * s[LOSS] + e * e * share
    s[E2] = lam * s[E2] + e * e
    s[EPS2] = lam * s[EPS2] + eps * eps
    s[Y2] = lam * s[Y2] + y * y
    s[FAST_E2] = FAST * s[FAST_E2] + (1.0 - FAST) * e * e
    s[FAST_Y2] = FAST * s[FAST_Y2] + (1.0 - FAST) * y * y
    if s[LAGS] > 0.0:
        correlate(residuals, products, eps, lam)
    s[UPDATES] += 1.0
    s[SINCE] += 1.0
    now, usual = s[FAST_E2] * s[S1], max(s[FAST_Y2] * s[S1], s[Y2]) + 1e-4 * s[S1]
    if s[DIVERGED] == 0.0:
        if s[SINCE] > s[WARM] and now > 4.0 * usual:
            s[DIVERGED] = 1.0
    elif s[SINCE] > 2.0 * s[WARM] and now < 2.0 * usual:
        s[DIVERGED] = 0.0
