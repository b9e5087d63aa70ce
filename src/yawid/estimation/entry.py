"""What is called from outside: a sample, a block, a release, a prediction, a row of results."""

# numba infers the types: float64 arrays and floats.
# mypy: disable-error-code="no-untyped-def, no-untyped-call"
from __future__ import annotations

import math

from yawid.estimation.kernel import jit, p_entry
from yawid.estimation.recursion import expect, take
from yawid.estimation.state import (
    BIAS,
    BROKEN,
    COUNT,
    COVARIANCE,
    FACTORS,
    FITTING,
    HEAD,
    HELD,
    HOLDING,
    INNOVATION,
    INPUTS,
    LAGS,
    LAMBDA,
    LAMBDA_END,
    LOSS,
    MINIMUM,
    NA,
    PHASE,
    RESIDUAL,
    RUNNING,
    S1,
    S2,
    SAMPLES,
    SCALED,
    SIGNALS,
    START_FIT,
    STATUS,
    THETA,
    UNITS,
    UPPER,
    WARMING_UP,
    WINDOW,
    Y_HAT,
    D,
    M,
    N,
    Y,
    views,
)


@jit
def _scale(s, v):
    """Set the factors from the full window; False where a channel in use moves too little."""
    window, w, width, factors = v[SAMPLES], int(s[WINDOW]), int(s[M]) + 2, v[FACTORS]
    for j in range(int(s[M]) + 1):
        mean, spread = 0.0, 0.0
        for i in range(w):
            mean += window[i * width + 1 + j] / w
        for i in range(w):
            spread += (window[i * width + 1 + j] - mean) ** 2 / w
        if (j == 0 or v[SIGNALS][4 * j + 3] > 0.0) and not s[MINIMUM] < math.sqrt(
            spread
        ) < math.inf:
            return False
        if s[SCALED] > 0.0 and spread > 0.0:  # a power of two scales without rounding
            factors[j] = 2.0 ** -math.floor(0.5 * math.log2(spread) + 0.5)
    p = int(s[NA])
    for j in range(1, int(s[M]) + 1):
        for _ in range(int(v[SIGNALS][4 * j + 3])):
            v[UNITS][p] = factors[j] / factors[0]
            p += 1
    if s[BIAS] > 0.0:
        v[UNITS][len(v[THETA]) - 1] = 1.0 / factors[0]
    return True


@jit
def release(s, frozen):
    """Run through the window's samples, oldest first, and recurse from now on."""
    v = views(s)
    w, width = int(s[WINDOW]), int(s[M]) + 2
    s[PHASE] = RUNNING
    for i in range(w):
        row = ((int(s[HEAD]) + i) % w) * width
        s[BROKEN] = max(s[BROKEN], v[SAMPLES][row])
        s[Y] = v[SAMPLES][row + 1]
        for j in range(int(s[M])):
            v[INPUTS][j] = v[SAMPLES][row + 2 + j]
        take(s, v, frozen)
    if frozen:
        s[LAMBDA] = s[LAMBDA_END]
    s[COUNT] = 0.0
    v[SAMPLES][:] = 0.0
    s[Y_HAT], s[INNOVATION] = math.nan, math.nan  # nothing could be predicted before this sample


@jit
def _collect(s, v):
    """Keep the sample in the window; when the window is full and moves, scale and release it."""
    w, width, head = int(s[WINDOW]), int(s[M]) + 2, int(s[HEAD])
    if s[COUNT] == s[WINDOW]:
        s[HEAD], s[HELD] = float((head + 1) % w), s[HELD] + 1.0
    else:
        s[COUNT] += 1.0
    row = ((head + int(s[COUNT]) - 1) % w) * width if s[HEAD] == head else head * width
    v[SAMPLES][row], v[SAMPLES][row + 1] = s[BROKEN], s[Y]
    for j in range(int(s[M])):
        v[SAMPLES][row + 2 + j] = v[INPUTS][j]
    s[BROKEN] = 0.0
    s[Y_HAT], s[INNOVATION], s[RESIDUAL] = math.nan, math.nan, math.nan
    s[STATUS] = WARMING_UP
    if s[COUNT] == s[WINDOW] and _scale(s, v):
        if s[START_FIT] > 0.0:
            s[PHASE] = FITTING
        else:
            release(s, False)


@jit
def _sample(s, v):
    finite = abs(s[Y]) < math.inf
    for j in range(len(v[INPUTS])):
        finite = finite and abs(v[INPUTS][j]) < math.inf
    if not finite:
        s[HELD] += 1.0
        s[BROKEN] = 1.0
        s[Y_HAT], s[INNOVATION], s[RESIDUAL], s[STATUS] = math.nan, math.nan, math.nan, HOLDING
    elif s[PHASE] == RUNNING:
        take(s, v, False)
    else:
        _collect(s, v)


@jit
def step(s):
    """Take the one sample in its slots; the caller looks at PHASE for a fit to be made."""
    _sample(s, views(s))


@jit
def predict(s):
    """Return y_hat for the inputs in their slots; spoils s, so give it a copy."""
    v = views(s)
    return expect(s, v) / v[FACTORS][0] if s[PHASE] == RUNNING else math.nan


@jit
def noise_variance(s):
    """Variance of the innovation on scaled signals; NaN before the first update."""
    if s[S1] == 0.0:
        return math.nan
    return s[LOSS] / max(s[S1] - s[N] * s[S2] / s[S1], 1.0)


@jit
def covariance_entry(s, v, i, j):
    """Covariance of theta[i] and theta[j], i <= j, in the user's units."""
    n = len(v[THETA])
    if s[S1] == 0.0:
        return math.nan
    over_noise = (
        v[COVARIANCE][i * n + j] if s[LAGS] > 0.0 else p_entry(v[D], v[UPPER], i, j) * s[S2] / s[S1]
    )
    return over_noise * noise_variance(s) * v[UNITS][i] * v[UNITS][j]


@jit
def read(s, v, row):
    """Fill row with theta, theta_std, y_hat, innovation, residual, noise_std, status, covariance."""
    n = len(v[THETA])
    for i in range(n):
        variance = covariance_entry(s, v, i, i)
        row[i] = v[THETA][i] * v[UNITS][i]
        row[n + i] = 0.0 if variance < 0.0 else math.sqrt(variance)
    row[2 * n], row[2 * n + 1], row[2 * n + 2] = s[Y_HAT], s[INNOVATION], s[RESIDUAL]
    row[2 * n + 3], row[2 * n + 4] = math.sqrt(noise_variance(s)) / v[FACTORS][0], s[STATUS]
    if len(row) > 2 * n + 5:
        for i in range(n):
            for j in range(i, n):
                entry = covariance_entry(s, v, i, j)
                row[2 * n + 5 + i * n + j] = entry
                row[2 * n + 5 + j * n + i] = entry


@jit
def run(s, u, y, out, first):
    """Take samples from the first on into rows of out (or only the last); stop where a fit is due.

    u (samples, M), y (samples,). Returns the number of samples taken.
    """
    v = views(s)
    for k in range(first, len(y)):
        s[Y] = y[k]
        for j in range(u.shape[1]):
            v[INPUTS][j] = u[k, j]
        _sample(s, v)
        if s[PHASE] == FITTING:
            return k
        if len(out) == len(y):
            read(s, v, out[k])
    if len(out) != len(y):
        read(s, v, out[0])
    return len(y)
