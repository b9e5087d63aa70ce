"""One step of the recursion on the packed state (paper eq. 28-33; Ljung and Soderstrom 1983)."""

# numba infers the types: float64 arrays and floats.
# mypy: disable-error-code="no-untyped-def, no-untyped-call"
from __future__ import annotations

import math

from yawid.estimation.kernel import bierman, follow_covariance, hot, jit, stable
from yawid.estimation.state import (
    BIAS,
    BROKEN,
    COVARIANCE,
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
    D,
    N,
    Y,
)
from yawid.estimation.upkeep import account, adapt


@hot
def _shift(register, heads, fresh):
    """Move all of the registers on by one and enter the fresh values at their heads.

    A signal without a register writes where the next one will, the last one into the spare.
    """
    for i in range(len(register) - 1, 0, -1):
        register[i] = register[i - 1]
    for j in range(len(fresh)):
        register[int(heads[j])] = fresh[j]


@hot
def _filter(s, at):
    """Pass the fresh values through 1/C(q) into the filtered registers.

    While lambda(t) is on its way, C's zeros are drawn in as far: an early C may lie at the edge.
    """
    filtered = s[at[FILTERED] : at[FILTERED + 1]]
    heads = s[at[HEADS] : at[HEADS + 1]]
    fresh = s[at[FRESH] : at[FRESH + 1]]
    theta = s[at[THETA] : at[THETA + 1]]
    scratch = s[at[SCRATCH] : at[SCRATCH + 1]]
    nc = int(s[NC])
    first = int(s[N]) - nc - int(s[BIAS])
    contraction = 1.0 - (s[LAMBDA_END] - s[LAMBDA])
    for j in range(len(fresh)):
        if heads[j + 1] > heads[j]:
            x, power, start = fresh[j], contraction, int(heads[j])
            for i in range(nc):
                x -= power * theta[first + i] * filtered[start + i]
                power *= contraction
            scratch[j] = x
    _shift(filtered, heads, scratch[: len(fresh)])


@jit
def _open(s, at):
    """Empty the registers: the samples before are not the neighbours of those that follow."""
    raw = s[at[RAW] : at[RAW + 1]]
    filtered = s[at[FILTERED] : at[FILTERED + 1]]
    echo = s[at[ECHO] : at[ECHO + 1]]
    residuals = s[at[RESIDUALS] : at[RESIDUALS + 1]]
    fresh = s[at[FRESH] : at[FRESH + 1]]
    raw[:] = 0.0
    filtered[:] = 0.0
    echo[:] = 0.0
    residuals[:] = 0.0
    fresh[:] = 0.0
    s[FILL], s[BROKEN] = 0.0, 0.0


@jit
def _restart(s, at):
    """Forget theta, P and the statistics after a non-finite result."""
    theta = s[at[THETA] : at[THETA + 1]]
    d = s[at[D] : at[D + 1]]
    covariance = s[at[COVARIANCE] : at[COVARIANCE + 1]]
    upper = s[at[UPPER] : at[UPPER + 1]]
    products = s[at[PRODUCTS] : at[PRODUCTS + 1]]
    least = s[at[LEAST] : at[LEAST + 1]]
    n = len(theta)
    theta[:] = 0.0
    d[:] = s[P0]
    upper[:] = 0.0
    least[:] = s[P0]
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
    theta = s[at[THETA] : at[THETA + 1]]
    d = s[at[D] : at[D + 1]]
    phi = s[at[PHI] : at[PHI + 1]]
    gain = s[at[GAIN] : at[GAIN + 1]]
    psi = s[at[PSI] : at[PSI + 1]]
    filtered = s[at[FILTERED] : at[FILTERED + 1]]
    taps = s[at[TAPS] : at[TAPS + 1]]
    upper = s[at[UPPER] : at[UPPER + 1]]
    scratch = s[at[SCRATCH] : at[SCRATCH + 1]]
    covariance = s[at[COVARIANCE] : at[COVARIANCE + 1]]
    echo = s[at[ECHO] : at[ECHO + 1]]
    if s[RML] == 0.0 or s[SINCE] < PSI_FROM:
        psi = phi
    else:
        for i in range(len(psi)):
            psi[i] = filtered[int(taps[i])]
    lam = s[LAMBDA]
    inverse = bierman(d, upper, psi, lam, gain)
    step = e * inverse
    if s[RML] > 0.0 and s[NC] > 0.0:
        possible = _stable_step(s, theta, gain, scratch, step)
        if possible != step:
            s[HALVED] += 1.0
        step = possible
    along = 0.0
    for i in range(len(theta)):
        theta[i] += step * gain[i]
        along += gain[i] * phi[i]
    eps = e - step * along
    if not (inverse > 0.0 and e * e + eps * eps < math.inf):
        return math.nan
    if s[LAGS] > 0.0:
        memory = 1.0 - min(1.0, max(1.0 / s[LAGS], FEW / (s[S1] + 1.0)))
        follow_covariance(covariance, echo, psi, gain, scratch, inverse, e, memory)
    adapt(s, at, lam)
    account(s, at, y, e, eps, lam, lam * inverse)
    return eps


@hot
def expect(s, at):
    """Enter what is known before y and return the scaled y_hat, NaN while the lags are not full."""
    inputs = s[at[INPUTS] : at[INPUTS + 1]]
    factors = s[at[FACTORS] : at[FACTORS + 1]]
    fresh = s[at[FRESH] : at[FRESH + 1]]
    raw = s[at[RAW] : at[RAW + 1]]
    heads = s[at[HEADS] : at[HEADS + 1]]
    taps = s[at[TAPS] : at[TAPS + 1]]
    phi = s[at[PHI] : at[PHI + 1]]
    theta = s[at[THETA] : at[THETA + 1]]
    if s[BROKEN] > 0.0:
        _open(s, at)
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
        phi[i] = raw[int(taps[i])]
        y_hat += phi[i] * theta[i]
    return y_hat


@hot
def take(s, at, frozen):
    """Take the sample in its slots through the recursion; frozen leaves theta and P as they are."""
    factors = s[at[FACTORS] : at[FACTORS + 1]]
    fresh = s[at[FRESH] : at[FRESH + 1]]
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
            _restart(s, at)
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
