"""What is called from outside: a sample, a block, a release, a prediction, a row of results."""

# numba infers the types: float64 arrays and floats.
# mypy: disable-error-code="no-untyped-def, no-untyped-call"
from __future__ import annotations

import math

from yawid.estimation.kernel.forgetting import noise_variance
from yawid.estimation.kernel.linear_algebra import hot, jit, p_entry, part
from yawid.estimation.kernel.recursion import expect, take
from yawid.estimation.kernel.state import (
    BIAS,
    BROKEN,
    COUNT,
    COVARIANCE,
    FACTORS,
    FITTING,
    HEAD,
    HEADS,
    HELD,
    HOLDING,
    INNOVATION,
    INPUTS,
    LAGS,
    LAMBDA,
    LAMBDA_END,
    MINIMUM,
    PHASE,
    RESIDUAL,
    RUNNING,
    S1,
    S2,
    SAMPLES,
    SCALED,
    START_FIT,
    STATUS,
    TAPS,
    THETA,
    UNITS,
    UPPER,
    WARMING_UP,
    WINDOW,
    Y_HAT,
    D,
    M,
    Y,
    parts,
)

TAKEN, FIT_DUE, INFINITE = 0, 1, 2  # what step returns


@jit
def _scale(s):
    """Set the factors from the full window; False where a channel in use moves too little."""
    s = part(s, 0, len(s))
    at = parts(s)
    samples = at[SAMPLES]
    factors = at[FACTORS]
    heads = at[HEADS]
    units = at[UNITS]
    taps = at[TAPS]
    w, width = int(s[WINDOW]), int(s[M]) + 2
    for j in range(int(s[M]) + 1):
        mean, spread = 0.0, 0.0
        for i in range(w):
            mean += samples[i * width + 1 + j] / w
        for i in range(w):
            spread += (samples[i * width + 1 + j] - mean) ** 2 / w
        used = j == 0 or heads[j + 1] > heads[j]
        if used and not s[MINIMUM] <= math.sqrt(spread) < math.inf:
            factors[:] = 1.0
            return False
        if s[SCALED] > 0.0 and spread > 0.0:  # a power of two scales without rounding
            factors[j] = 2.0 ** -math.floor(0.5 * math.log2(spread) + 0.5)
    for i in range(len(units)):
        for j in range(1, int(s[M]) + 1):
            if heads[j] <= taps[i] < heads[j + 1]:
                units[i] = factors[j] / factors[0]
    if s[BIAS] > 0.0:
        units[len(units) - 1] = 1.0 / factors[0]
    return True


@jit
def release(s, frozen):
    """Run through the window's samples, oldest first, and recurse from now on."""
    s = part(s, 0, len(s))
    at = parts(s)
    samples = at[SAMPLES]
    inputs = at[INPUTS]
    w, width = int(s[WINDOW]), int(s[M]) + 2
    s[PHASE] = RUNNING
    for i in range(w):
        row = ((int(s[HEAD]) + i) % w) * width
        s[BROKEN] = max(s[BROKEN], samples[row])
        s[Y] = samples[row + 1]
        for j in range(int(s[M])):
            inputs[j] = samples[row + 2 + j]
        take(s, at, frozen)
    if frozen > 0.0:
        s[LAMBDA] = s[LAMBDA_END]
    s[COUNT] = 0.0
    samples[:] = 0.0
    s[Y_HAT], s[INNOVATION] = math.nan, math.nan  # nothing could be predicted before this sample


@jit
def _collect(s):
    """Keep the sample in the window; when the window is full and moves, scale and release it."""
    s = part(s, 0, len(s))
    at = parts(s)
    samples = at[SAMPLES]
    inputs = at[INPUTS]
    w, width, head = int(s[WINDOW]), int(s[M]) + 2, int(s[HEAD])
    if s[COUNT] == s[WINDOW]:
        s[HEAD], s[HELD] = float((head + 1) % w), s[HELD] + 1.0
    else:
        s[COUNT] += 1.0
    row = ((head + int(s[COUNT]) - 1) % w) * width if s[HEAD] == head else head * width
    samples[row], samples[row + 1] = s[BROKEN], s[Y]
    for j in range(int(s[M])):
        samples[row + 2 + j] = inputs[j]
    s[BROKEN] = 0.0
    s[Y_HAT], s[INNOVATION], s[RESIDUAL] = math.nan, math.nan, math.nan
    s[STATUS] = WARMING_UP
    if s[COUNT] == s[WINDOW] and _scale(s):
        if s[START_FIT] > 0.0:
            s[PHASE] = FITTING
        else:
            release(s, 0.0)


@hot
def _sample(s, at):
    inputs = at[INPUTS]
    finite = abs(s[Y]) < math.inf
    for j in range(len(inputs)):
        finite = finite and abs(inputs[j]) < math.inf
    if not finite:
        s[HELD] += 1.0
        s[BROKEN] = 1.0
        s[Y_HAT], s[INNOVATION], s[RESIDUAL], s[STATUS] = math.nan, math.nan, math.nan, HOLDING
    elif s[PHASE] == RUNNING:
        take(s, at, 0.0)
    else:
        _collect(s)


@jit
def step(s, u, y):
    """Take one sample of one input, or nothing if it is infinite; return what came of it."""
    if abs(u) == math.inf or abs(y) == math.inf:
        return INFINITE
    s = part(s, 0, len(s))
    at = parts(s)
    at[INPUTS][0] = u
    s[Y] = y
    _sample(s, at)
    return FIT_DUE if s[PHASE] == FITTING else TAKEN


@hot
def _finite_or_nan(u, y):
    """Tell whether nothing in u (samples, M) and y (samples,) is infinite."""
    for k in range(len(y)):
        if abs(y[k]) == math.inf:
            return False
        for j in range(u.shape[1]):
            if abs(u[k, j]) == math.inf:
                return False
    return True


@jit
def predict(s):
    """Return y_hat for the inputs in their slots; spoils s, so give it a copy."""
    s = part(s, 0, len(s))
    at = parts(s)
    factors = at[FACTORS]
    return expect(s, at) / factors[0] if s[PHASE] == RUNNING else math.nan


@hot
def covariance_entry(s, at, i, j):
    """Covariance of theta[i] and theta[j], i <= j, in the user's units."""
    theta = at[THETA]
    covariance = at[COVARIANCE]
    d = at[D]
    upper = at[UPPER]
    units = at[UNITS]
    n = len(theta)
    if s[S1] == 0.0:
        return math.nan
    if s[LAGS] > 0.0:
        return covariance[i * n + j] * units[i] * units[j]
    # cov = sigma^2 P S2 / S1: sigma^2 P for lambda = 1, sigma^2 P / (1 + lambda) in steady state
    return noise_variance(s) * p_entry(d, upper, i, j) * s[S2] / s[S1] * units[i] * units[j]


@jit
def read(s, row):
    """Fill row (2 N + 5,) with what came of the last sample, (2 N + 5 + N N,) with covariance.

    theta, theta_std, y_hat, innovation, residual, noise_std, status.
    """
    s = part(s, 0, len(s))
    at = parts(s)
    theta = at[THETA]
    units = at[UNITS]
    factors = at[FACTORS]
    n = len(theta)
    for i in range(n):
        variance = covariance_entry(s, at, i, i)
        row[i] = theta[i] * units[i]
        row[n + i] = 0.0 if variance < 0.0 else math.sqrt(variance)
    scale = 1.0 / factors[0]
    row[2 * n], row[2 * n + 1] = s[Y_HAT] * scale, s[INNOVATION] * scale
    row[2 * n + 2], row[2 * n + 3] = s[RESIDUAL] * scale, math.sqrt(noise_variance(s)) * scale
    row[2 * n + 4] = s[STATUS]
    if len(row) > 2 * n + 5:
        for i in range(n):
            for j in range(i, n):
                entry = covariance_entry(s, at, i, j)
                row[2 * n + 5 + i * n + j] = entry
                row[2 * n + 5 + j * n + i] = entry


@jit
def run(s, u, y, out, first):
    """Take samples from the first on into rows of out (or only the last); stop where a fit is due.

    u (samples, M), y (samples,). Returns the number of samples taken; -1, and takes none, where
    one of them all is infinite.
    """
    if first == 0 and not _finite_or_nan(u, y):
        return -1
    s = part(s, 0, len(s))
    at = parts(s)
    inputs = at[INPUTS]
    for k in range(first, len(y)):
        s[Y] = y[k]
        for j in range(u.shape[1]):
            inputs[j] = u[k, j]
        _sample(s, at)
        if s[PHASE] == FITTING:
            return k
        if len(out) == len(y):
            read(s, out[k])
    if len(out) != len(y):
        read(s, out[0])
    return len(y)
