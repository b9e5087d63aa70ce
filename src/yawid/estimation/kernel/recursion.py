"""One step of the recursion on the packed state (paper eq. 28-33; Ljung and Soderstrom 1983)."""

# numba infers the types: float64 arrays and floats.
# mypy: disable-error-code="no-untyped-def, no-untyped-call"
from __future__ import annotations

import math

import numpy as np

from yawid.estimation.kernel.forgetting import account, adapt
from yawid.estimation.kernel.linear_algebra import bierman, follow_covariance, hot, jit, stable
from yawid.estimation.kernel.state import (
    BEST,
    BIAS,
    BROKEN,
    COVARIANCE,
    D_MAX,
    DEPTH,
    DIVERGED,
    DIVERGING,
    ECHO,
    FACTORS,
    FAST_Y2,
    FEW,
    FILL,
    FILTERED,
    FRESH,
    GAIN,
    HALVED,
    HALVINGS,
    HEADS,
    HELD,
    HOLDING,
    INNOVATION,
    INPUTS,
    LAGS,
    LAMBDA,
    LAMBDA_END,
    LAMBDA_START,
    LEAST,
    NC,
    P0,
    PHI,
    PRODUCTS,
    PSI,
    PSI_FROM,
    RAW,
    RESIDUAL,
    RESIDUALS,
    RESTARTS,
    RML,
    S1,
    SCRATCH,
    SINCE,
    STATUS,
    TAPS,
    THETA,
    TRACKING,
    UPPER,
    WARM,
    WARMING_UP,
    Y_HAT,
    C,
    D,
    Y,
    parts,
)

ONE = np.uint64(1)


@hot
def _shift(register, heads, fresh):
    """Move all of the registers on by one and enter the fresh values at their heads.

    A signal without a register writes where the next one will, the last one into the spare.
    """
    for i in range(len(register) - 1, 0, -1):
        register[i] = register[i - 1]
    for j in range(len(fresh)):
        register[heads[j]] = fresh[j]


@hot
def _filter(s, at):
    """Pass the fresh values through 1/C(q) into the filtered registers.

    While lambda(t) is on its way, C's zeros are drawn in as far: an early C may lie at the edge.
    """
    filtered = at[FILTERED]
    heads = at[HEADS]
    fresh = at[FRESH]
    theta = at[THETA]
    scratch = at[SCRATCH]
    c = at[C]
    contraction = 1.0 - (s[LAMBDA_END] - s[LAMBDA])
    power, first = contraction, len(theta) - len(c) - int(s[BIAS])
    for i in range(len(c)):
        c[i] = power * theta[first + i]
        power *= contraction
    for j in range(len(fresh)):
        head = heads[j]
        if heads[j + 1] > head:
            x = fresh[j]
            for i in range(len(c)):
                x -= c[i] * filtered[head]
                head += ONE
            scratch[j] = x
    _shift(filtered, heads, scratch[: len(fresh)])


@jit
def _open(s):
    """Empty the registers: the samples before are not the neighbours of those that follow."""
    at = parts(s)
    raw = at[RAW]
    filtered = at[FILTERED]
    echo = at[ECHO]
    residuals = at[RESIDUALS]
    fresh = at[FRESH]
    raw[:] = 0.0
    filtered[:] = 0.0
    echo[:] = 0.0
    residuals[:] = 0.0
    fresh[:] = 0.0
    s[FILL], s[BROKEN] = 0.0, 0.0


@jit
def _restart(s):
    """Forget theta, P and the statistics after a non-finite result."""
    at = parts(s)
    theta = at[THETA]
    d = at[D]
    covariance = at[COVARIANCE]
    upper = at[UPPER]
    products = at[PRODUCTS]
    least = at[LEAST]
    best = at[BEST]
    n = len(theta)
    theta[:] = 0.0
    d[:] = s[P0]
    upper[:] = 0.0
    least[:] = s[P0]
    best[:] = s[P0]
    covariance[:] = 0.0
    for i in range(n if s[LAGS] > 0.0 else 0):
        covariance[i * n + i] = s[P0]
    products[:] = 0.0
    s[LAMBDA] = s[LAMBDA_START]
    s[S1 : FAST_Y2 + 1] = 0.0
    s[SINCE], s[BROKEN] = 0.0, 1.0
    s[DIVERGED] = 1.0
    s[RESTARTS] += 1.0


@hot
def _stable_step(s, theta, gain, scratch, step):
    """Halve the step along the gain until it leaves C(q) stable; return it, 0 at worst."""
    nc = int(s[NC])
    trial = scratch[:nc]
    first = len(theta) - nc - int(s[BIAS])
    for _ in range(HALVINGS):
        for i in range(nc):
            trial[i] = theta[first + i] + step * gain[first + i]
        if stable(trial):
            return step
        step *= 0.5
    return 0.0


@hot
def _learn(s, at, y, e):
    """Update theta and P by the innovation and phi, psi; return the residual, NaN for a failure."""
    theta = at[THETA]
    d = at[D]
    phi = at[PHI]
    gain = at[GAIN]
    psi = at[PSI]
    filtered = at[FILTERED]
    taps = at[TAPS]
    upper = at[UPPER]
    scratch = at[SCRATCH]
    covariance = at[COVARIANCE]
    echo = at[ECHO]
    if s[RML] == 0.0 or s[SINCE] < PSI_FROM:
        psi = phi
    else:
        for i in range(len(psi)):
            psi[i] = filtered[taps[i]]
    lam = s[LAMBDA]
    inverse = bierman(d, upper, psi, lam, gain, s[D_MAX])
    step, share = e * inverse, lam * inverse
    if s[RML] > 0.0:
        if s[NC] > 0.0:
            possible = _stable_step(s, theta, gain, scratch, step)
            if possible != step:
                s[HALVED] += 1.0
            step = possible
        along = 0.0
        for i in range(len(theta)):
            theta[i] += step * gain[i]
            along += gain[i] * phi[i]
        eps = e - step * along
    else:
        for i in range(len(theta)):
            theta[i] += step * gain[i]
        eps = e * share  # gain' phi = alpha - lambda where psi = phi
    if not (inverse > 0.0 and e * e + eps * eps < math.inf):
        return math.nan
    if s[LAGS] > 0.0:
        memory = 1.0 - min(1.0, max(1.0 / s[LAGS], FEW / (s[S1] + 1.0)))
        follow_covariance(covariance, echo, psi, gain, scratch, inverse, e, memory)
    adapt(s, at, lam)
    account(s, at, y, e, eps, lam, share)
    return eps


@hot
def expect(s, at):
    """Enter what is known before y and return the scaled y_hat, NaN while the lags are not full."""
    inputs = at[INPUTS]
    factors = at[FACTORS]
    fresh = at[FRESH]
    raw = at[RAW]
    heads = at[HEADS]
    taps = at[TAPS]
    phi = at[PHI]
    theta = at[THETA]
    if s[BROKEN] > 0.0:
        _open(s)
    for j in range(len(inputs)):
        fresh[1 + j] = inputs[j] * factors[1 + j]
    fresh[len(fresh) - 1] = 1.0
    if s[RML] > 0.0:
        _filter(s, at)
    _shift(raw, heads, fresh)
    s[FILL] += 1.0
    if s[FILL] <= s[DEPTH]:
        return math.nan
    y_hat = 0.0
    for i in range(len(theta)):
        phi[i] = raw[taps[i]]
        y_hat += phi[i] * theta[i]
    return y_hat


@hot
def take(s, at, frozen):
    """Take the sample in its slots through the recursion; frozen leaves theta and P as they are."""
    factors = at[FACTORS]
    fresh = at[FRESH]
    y = s[Y] * factors[0]
    y_hat = expect(s, at)
    e = y - y_hat
    eps = e if frozen > 0.0 or s[SINCE] > 0.0 else 0.0
    learning = s[FILL] > s[DEPTH] + s[NC]
    if learning and frozen > 0.0:
        account(s, at, y, e, e, s[LAMBDA_END], 1.0)
    elif learning:
        eps = _learn(s, at, y, e)
        if not abs(eps) < math.inf:
            _restart(s)
            learning = False
    if not learning:
        s[HELD] += 1.0
    fresh[0] = -y
    fresh[len(fresh) - 2] = eps if s[FILL] > s[DEPTH] else 0.0
    s[Y_HAT], s[INNOVATION], s[RESIDUAL] = y_hat, e, eps
    if s[DIVERGED] > 0.0:
        s[STATUS] = DIVERGING
    elif s[SINCE] < s[WARM]:
        s[STATUS] = WARMING_UP
    else:
        s[STATUS] = TRACKING if learning else HOLDING
