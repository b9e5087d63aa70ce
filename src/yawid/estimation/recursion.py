"""One step of the recursion on the packed state (paper eq. 28-33; Ljung and Soderstrom 1983)."""

# numba infers the types: float64 arrays and floats.
# mypy: disable-error-code="no-untyped-def, no-untyped-call"
from __future__ import annotations

import math

from yawid.estimation.kernel import (
    HALVINGS,
    bierman,
    correlate,
    drift_entry,
    floor,
    follow_covariance,
    gather,
    jit,
    push,
    stable,
)
from yawid.estimation.state import (
    BIAS,
    BROKEN,
    COVARIANCE,
    D_MAX,
    DEPTH,
    DIVERGED,
    DIVERGING,
    DRIFT,
    DRIFTS,
    E2,
    ECHOES,
    EPS2,
    FACTORS,
    FAST,
    FAST_E2,
    FAST_Y2,
    FILL,
    FILTERED,
    FLOOR,
    GAIN,
    HALVED,
    HELD,
    HOLDING,
    INNOVATION,
    INPUTS,
    LAGS,
    LAMBDA,
    LAMBDA_END,
    LAMBDA_RATE,
    LAMBDA_START,
    LOSS,
    NC,
    NEXT,
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
    S2,
    SCRATCH,
    SIGNALS,
    SINCE,
    STATUS,
    THETA,
    TRACKING,
    UPDATES,
    UPPER,
    WARM,
    WARMING_UP,
    Y2,
    Y_HAT,
    D,
    M,
    N,
    Y,
)


@jit
def _over_c(s, theta, register, start, x):
    """Return x filtered by 1/C(q); the register holds the filter's outputs, newest first.

    While lambda(t) is on its way, C's zeros are drawn in as far: an early C may lie at the edge.
    """
    nc = int(s[NC])
    first = int(s[N]) - nc - int(s[BIAS])
    contraction = 1.0 - (s[LAMBDA_END] - s[LAMBDA])
    power = contraction
    for i in range(nc):
        x -= power * theta[first + i] * register[start + i]
        power *= contraction
    return x


@jit
def _enter(s, v, signal, x):
    """Enter the newest value of y, an input, the residual or the bias into its registers."""
    raw, filtered, signals = v[RAW], v[FILTERED], v[SIGNALS]
    start, length = int(signals[4 * signal]), int(signals[4 * signal + 1])
    push(raw, start, length, x)
    if s[RML] > 0.0 and length > 0:
        push(filtered, start, length, _over_c(s, v[THETA], filtered, start, x))


@jit
def _open(s, v):
    """Empty the registers: the samples before are not the neighbours of those that follow."""
    v[RAW][:] = 0.0
    v[FILTERED][:] = 0.0
    v[ECHOES][:] = 0.0
    v[RESIDUALS][:] = 0.0
    s[FILL], s[BROKEN] = 0.0, 0.0


@jit
def _restart(s, v):
    """Forget theta, P and the statistics after a non-finite result."""
    theta, d, covariance, n = v[THETA], v[D], v[COVARIANCE], len(v[THETA])
    theta[:] = 0.0
    d[:] = s[P0]
    v[UPPER][:] = 0.0
    covariance[:] = 0.0
    for i in range(n if s[LAGS] > 0.0 else 0):
        covariance[i * n + i] = s[P0]
    v[PRODUCTS][:] = 0.0
    s[LAMBDA] = s[LAMBDA_START]
    s[S1 : FAST_Y2 + 1] = 0.0
    s[SINCE], s[BROKEN] = 0.0, 1.0
    s[DIVERGED] = 1.0
    s[RESTARTS] += 1.0


@jit
def _stable_step(s, theta, gain, scratch, step):
    """Halve the step along the gain until C(q) is stable after it; return it, 0 if nothing helps."""
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


@jit
def _adapt(s, v, lam):
    """Let P grow by forgetting or drift, no further than its cap, and keep information in it."""
    d, upper, drift, n = v[D], v[UPPER], v[DRIFT], len(v[D])
    over = 1.0 / lam
    for i in range(n):
        d[i] = min(d[i] * over, s[D_MAX])
    if s[DRIFTS] > 0.0:
        for i in range(n):
            if drift[i] > 0.0:
                drift_entry(d, upper, i, drift[i], v[SCRATCH])
                if s[LAGS] > 0.0:
                    v[COVARIANCE][i * n + i] += drift[i]
    if s[FLOOR] > 0.0:
        k = int(s[NEXT])
        floor(d, upper, k, s[FLOOR], v[GAIN])
        s[NEXT] = 0.0 if k + 1 == n else k + 1.0
    s[LAMBDA] = s[LAMBDA_RATE] * lam + (1.0 - s[LAMBDA_RATE]) * s[LAMBDA_END]


@jit
def _account(s, v, y, e, eps, lam, share):
    """Keep the running sums, and test for divergence: y_hat much worse than none at all."""
    s[S1] = lam * s[S1] + 1.0
    s[S2] = lam * lam * s[S2] + 1.0
    s[LOSS] = lam * s[LOSS] + e * e * share
    s[E2] = lam * s[E2] + e * e
    s[EPS2] = lam * s[EPS2] + eps * eps
    s[Y2] = lam * s[Y2] + y * y
    s[FAST_E2] = FAST * s[FAST_E2] + (1.0 - FAST) * e * e
    s[FAST_Y2] = FAST * s[FAST_Y2] + (1.0 - FAST) * y * y
    if s[LAGS] > 0.0:
        correlate(v[RESIDUALS], v[PRODUCTS], eps, lam)
    s[UPDATES] += 1.0
    s[SINCE] += 1.0
    usual = max(s[FAST_Y2], s[Y2] / s[S1]) + 1e-4
    if s[DIVERGED] == 0.0:
        if s[SINCE] > s[WARM] and s[FAST_E2] > 4.0 * usual:
            s[DIVERGED] = 1.0
    elif s[SINCE] > 2.0 * s[WARM] and s[FAST_E2] < 2.0 * usual:
        s[DIVERGED] = 0.0


@jit
def _learn(s, v, y, e):
    """Update theta and P by the innovation and phi, psi; return the residual, NaN for a failure."""
    theta, d, phi, gain, lam = v[THETA], v[D], v[PHI], v[GAIN], s[LAMBDA]
    psi = v[PSI] if s[RML] > 0.0 and s[SINCE] >= PSI_FROM else phi
    alpha = bierman(d, v[UPPER], psi, lam, gain)
    step = e / alpha
    if s[RML] > 0.0 and s[NC] > 0.0:
        possible = _stable_step(s, theta, gain, v[SCRATCH], step)
        if possible != step:
            s[HALVED] += 1.0
        step = possible
    eps = e
    for i in range(len(theta)):
        theta[i] += step * gain[i]
        eps -= step * gain[i] * phi[i]
    if not alpha + e * e + eps * eps < math.inf:
        return math.nan
    if s[LAGS] > 0.0:
        follow_covariance(v[COVARIANCE], v[ECHOES], v[PRODUCTS], psi, gain, v[SCRATCH], 1.0 / alpha)
    _adapt(s, v, lam)
    _account(s, v, y, e, eps, lam, lam / alpha)
    return eps


@jit
def expect(s, v):
    """Enter what is known before y and return the scaled y_hat, NaN while the lags are not full."""
    if s[BROKEN] > 0.0:
        _open(s, v)
    m = int(s[M])
    for j in range(m):
        _enter(s, v, j + 1, v[INPUTS][j] * v[FACTORS][j + 1])
    if s[BIAS] > 0.0:
        _enter(s, v, m + 2, 1.0)
    s[FILL] += 1.0
    if s[FILL] <= s[DEPTH]:
        return math.nan
    gather(v[RAW], v[SIGNALS], m + 3, v[PHI])
    y_hat = 0.0
    for i in range(len(v[THETA])):
        y_hat += v[PHI][i] * v[THETA][i]
    return y_hat


@jit
def take(s, v, frozen):
    """Take the sample in its slots through the recursion; frozen leaves theta and P as they are."""
    y, m = s[Y] * v[FACTORS][0], int(s[M])
    y_hat = expect(s, v)
    e = y - y_hat
    eps = e if frozen or s[SINCE] > 0.0 else 0.0
    learning = s[FILL] > s[DEPTH] + s[NC]
    if learning and frozen:
        _account(s, v, y, e, e, s[LAMBDA_END], 1.0)
    elif learning:
        if s[RML] > 0.0:
            gather(v[FILTERED], v[SIGNALS], m + 3, v[PSI])
        eps = _learn(s, v, y, e)
        if not abs(eps) < math.inf:
            _restart(s, v)
            learning = False
    if not learning:
        s[HELD] += 1.0
    _enter(s, v, 0, -y)
    _enter(s, v, m + 1, eps if s[FILL] > s[DEPTH] else 0.0)
    s[Y_HAT] = y_hat / v[FACTORS][0]
    s[INNOVATION] = e / v[FACTORS][0]
    s[RESIDUAL] = eps / v[FACTORS][0]
    if s[DIVERGED] > 0.0:
        s[STATUS] = DIVERGING
    elif s[SINCE] < s[WARM]:
        s[STATUS] = WARMING_UP
    else:
        s[STATUS] = TRACKING if learning else HOLDING
