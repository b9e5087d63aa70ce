"""One step of the recursion on the packed state (paper eq. 28-33; Ljung and Soderstrom 1983)."""

# numba infers the types: float64 arrays and floats.
# mypy: disable-error-code="no-untyped-def, no-untyped-call"
import math

import numpy as np

from yawid.estimation.kernel.forgetting import account, adapt
from yawid.estimation.kernel.linear_algebra import bierman, clear, follow_covariance, stable
from yawid.estimation.kernel.marks import hot, merged
from yawid.estimation.kernel.state import (
    DIVERGING,
    FEW,
    FROZEN,
    HALVINGS,
    HOLDING,
    PSI_FROM,
    RESTARTING,
    TRACKING,
    WARMING_UP,
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
    contraction = 1.0 - (s.lam_end - s.lam)
    power, first = contraction, len(at.theta) - len(at.c) - int(s.bias)
    for i in range(len(at.c)):
        at.c[i] = power * at.theta[first + i]
        power *= contraction
    for j in range(len(at.fresh)):
        head = at.heads[j]
        if at.heads[j + 1] > head:
            x = at.fresh[j]
            for i in range(len(at.c)):
                x -= at.c[i] * at.filtered[head]
                head += ONE
            at.scratch[j] = x
    _shift(at.filtered, at.heads, at.scratch[: len(at.fresh)])


@hot
def _open(s, at):
    """Empty the registers: the samples before are not the neighbours of those that follow."""
    clear(at.raw)
    clear(at.filtered)
    clear(at.echo)
    clear(at.residuals)
    clear(at.fresh)
    s.filled, s.broken = 0.0, 0.0


@hot
def _stable_step(s, theta, gain, trial, step):
    """Halve the step along the gain until it leaves C(q) stable; return it, 0 at worst.

    ``trial`` (nc,) is overwritten.
    """
    nc = len(trial)
    first = len(theta) - nc - int(s.bias)
    for _ in range(HALVINGS):
        for i in range(nc):
            trial[i] = theta[first + i] + step * gain[first + i]
        if stable(trial):
            return step
        step *= 0.5
    return 0.0


@merged
def _learn(s, at, e):
    """Update theta and P by the innovation and phi, psi.

    Return the residual, NaN for a failure, and the share of e^2 that the loss counts.
    """
    psi = at.phi
    if s.filters > 0.0 and s.since >= PSI_FROM:
        psi = at.psi
        for i in range(len(psi)):
            psi[i] = at.filtered[at.taps[i]]
    lam = s.lam
    inverse = bierman(at.d, at.upper, psi, lam, at.gain, s.d_max)
    step, share = e * inverse, lam * inverse
    if s.filters > 0.0:
        if s.nc > 0.0:
            possible = _stable_step(s, at.theta, at.gain, at.c, step)
            if possible != step:
                s.halved += 1.0
            step = possible
        along = 0.0
        for i in range(len(at.theta)):
            at.theta[i] += step * at.gain[i]
            along += at.gain[i] * at.phi[i]
        eps = e - step * along
    else:
        for i in range(len(at.theta)):
            at.theta[i] += step * at.gain[i]
        eps = e * share  # gain' phi = alpha - lambda where psi = phi
    if not (inverse > 0.0 and e * e + eps * eps < math.inf):
        return math.nan, share
    if s.lags > 0.0:
        memory = 1.0 - min(1.0, max(1.0 / s.lags, FEW / (s.s1 + 1.0)))
        follow_covariance(at.covariance, at.echo, psi, at.gain, at.scratch, inverse, e, memory)
    adapt(s, at, lam)
    return eps, share


@hot
def expect(s, at):
    """Enter what is known before y and return the scaled y_hat, NaN while the lags are not full."""
    if s.broken > 0.0:
        _open(s, at)
    for j in range(len(at.inputs)):
        at.fresh[1 + j] = at.inputs[j] * at.factors[1 + j]
    at.fresh[len(at.fresh) - 1] = 1.0
    if s.filters > 0.0:
        _filter(s, at)
    _shift(at.raw, at.heads, at.fresh)
    s.filled += 1.0
    if s.filled <= s.depth:
        return math.nan
    y_hat = 0.0
    for i in range(len(at.theta)):
        at.phi[i] = at.raw[at.taps[i]]
        y_hat += at.phi[i] * at.theta[i]
    return y_hat


@merged
def take(s, at):
    """Take the sample in its slots through the recursion; FROZEN leaves theta and P as they are."""
    y = s.y * at.factors[0]
    y_hat = expect(s, at)
    e = y - y_hat
    frozen = s.phase == FROZEN
    eps = e if frozen or s.since > 0.0 else 0.0
    learning = s.filled > s.depth + s.nc
    lam, share = s.lam_end, 1.0
    if learning and not frozen:
        lam = s.lam
        eps, share = _learn(s, at, e)
        if not abs(eps) < math.inf:
            s.phase = RESTARTING
            learning = False
    if learning:
        account(s, at, y, e, eps, lam, share)
    else:
        s.held += 1.0
    at.fresh[0] = -y
    at.fresh[len(at.fresh) - 2] = eps if s.filled > s.depth else 0.0
    s.y_hat, s.innovation, s.residual = y_hat, e, eps
    if s.diverged > 0.0:
        s.status = DIVERGING
    elif s.since < s.warm:
        s.status = WARMING_UP
    else:
        s.status = TRACKING if learning else HOLDING
