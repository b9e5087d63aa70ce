"""One sample through the recursion, in the order of the page at the top of ``armax.py``.

Paper eq. 28-33; Ljung and Soderstrom (1983), chapter 3. ``s`` is the header of the packed state and
``at`` its parts (``state.py`` names both); y, u and theta are scaled here.
"""

# numba infers the types: float64 arrays and floats.
# mypy: disable-error-code="no-untyped-def, no-untyped-call"
import math

import numpy as np

from yawid.estimation.kernel.linear_algebra import (
    bierman,
    clear,
    correlate,
    entry_of_p,
    floor,
    follow_covariance,
    stable,
)
from yawid.estimation.kernel.marks import called, hot, merged
from yawid.estimation.kernel.state import (
    DIVERGING,
    FULL,
    HOLDING,
    RESTARTING,
    TRACKING,
    WARMING_UP,
    header,
    parts,
)

PSI_FROM = 150  # rml: updates with psi = phi, until C is good enough to filter by
HALVINGS = 12  # trials of a step, each half the one before, until C is stable; else theta stays
FAST = 0.99  # forgetting factor of the test for divergence
FEW = 25.0  # updates needed for each lag of the residual's correlation that is followed
SLACK = 0.03  # the share by which P[k, k] may exceed its usual least, times the configured floor
SETTLING = 1000  # updates during which the usual least of P[k, k] is simply its least
FAST_FALL = 0.98  # after them, the usual least falls no faster than by this factor at a visit
SLOW_RISE = 1e-3  # the share by which the usual least rises within one memory
MOST_RISE = 10.0  # it never rises above this many times the smallest usual least so far
ONE = np.uint64(1)


@merged
def _scale(s, at):
    """Set ``factors`` and ``units`` from the full window, and return True.

    Where the standard deviation of y, or of an input in use, is below ``scale_minimum``, return
    False; all factors are 1 then.
    """
    w, width = int(s.window), int(s.m) + 2
    for j in range(int(s.m) + 1):
        mean, spread = 0.0, 0.0
        for i in range(w):
            mean += at.samples[i * width + 1 + j] / w
        for i in range(w):
            spread += (at.samples[i * width + 1 + j] - mean) ** 2 / w
        used = j == 0 or at.heads[j + 1] > at.heads[j]
        if used and not s.minimum <= math.sqrt(spread) < math.inf:
            for i in range(len(at.factors)):
                at.factors[i] = 1.0
            return False
        if s.scaled > 0.0 and spread > 0.0:  # a power of two scales without rounding
            at.factors[j] = 2.0 ** -math.floor(0.5 * math.log2(spread) + 0.5)
    for i in range(len(at.units)):
        for j in range(1, int(s.m) + 1):
            if at.heads[j] <= at.taps[i] < at.heads[j + 1]:
                at.units[i] = at.factors[j] / at.factors[0]
    if s.bias > 0.0:
        at.units[len(at.units) - 1] = 1.0 / at.factors[0]
    return True


@called
def gather(packed):
    """Put the sample into the window; once the window is full and its signals move, scale it."""
    s, at = header(packed), parts(packed)
    w, width, head = int(s.window), int(s.m) + 2, int(s.head)
    if s.count == s.window:
        s.head, s.held = float((head + 1) % w), s.held + 1.0
    else:
        s.count += 1.0
    row = ((head + int(s.count) - 1) % w) * width if s.head == head else head * width
    at.samples[row], at.samples[row + 1] = s.broken, s.y
    for j in range(int(s.m)):
        at.samples[row + 2 + j] = at.inputs[j]
    s.broken = 0.0
    s.y_hat, s.innovation, s.residual = math.nan, math.nan, math.nan
    s.status = WARMING_UP
    if s.count == s.window and _scale(s, at):
        s.phase = FULL


@hot
def _open(s, at):
    """Empty the registers: the samples before a break are not the lags of those after it."""
    clear(at.raw)
    clear(at.filtered)
    clear(at.echo)
    clear(at.residuals)
    clear(at.fresh)
    s.filled, s.broken = 0.0, 0.0


@hot
def _shift(register, heads, fresh):
    """Move all registers on by one sample and write the fresh values to their heads.

    A signal without a register has the head of the next one, which overwrites it; the last such
    signal writes to the spare place at the end.
    """
    for i in range(len(register) - 1, 0, -1):
        register[i] = register[i - 1]
    for j in range(len(fresh)):
        register[heads[j]] = fresh[j]


@hot
def _filter(s, at):
    """Pass the fresh values through 1/C(q) into the filtered registers.

    While lambda(k) is below its end, the zeros of C are multiplied by 1 - (lambda_end - lambda(k)):
    an early C may have zeros near the unit circle.
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
def expect(s, at):
    """Form phi(k) from what is known before y(k) and return y_hat(k) = phi' theta (eq. 30, 32).

    y_hat is scaled, and NaN while the lags are not full.
    """
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


@hot
def _stable_step(s, theta, gain, trial, step):
    """Halve the step along the gain until C(q) is stable after it; return it, 0 if it never is.

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


@hot
def _keep_information(s, at):
    """Apply the information floor to one parameter theta[k], the next one at each update.

    Where P[k, k] exceeds its usual least by more than the share SLACK / floor, add a
    pseudo-measurement of theta[k] equal to its estimate, with the weight that brings P[k, k] back
    to that limit; theta does not change. The usual least falls fast and rises slowly, over many
    memories, up to MOST_RISE times the smallest so far: neither days of poor excitation nor one
    wild sample can set it. While the signals excite, nothing is added: pseudo-measurements of
    a fixed weight would outweigh the little information that quiet noise has about C.
    """
    k, n = int(s.next), len(at.d)
    s.next = 0.0 if k + 1 == n else k + 1.0
    p = entry_of_p(at.d, at.upper, k, k)
    if p >= at.least[k]:
        rise = 1.0 + SLOW_RISE * n * (1.0 - s.lam_end)
        at.least[k] = min(at.least[k] * rise, MOST_RISE * at.best[k])
    else:
        at.least[k] = p if s.since < SETTLING else max(p, FAST_FALL * at.least[k])
        at.best[k] = min(at.best[k], at.least[k])
    limit = at.least[k] * (1.0 + SLACK / s.floor)
    if p > limit:
        floor(at.d, at.upper, k, 1.0 / limit - 1.0 / p, at.gain)


@hot
def _adapt(s, at, lam):
    """Apply the information floor, and move the forgetting factor towards its end."""
    if s.floor > 0.0:
        _keep_information(s, at)
    s.lam = s.lam_rate * lam + (1.0 - s.lam_rate) * s.lam_end


@merged
def _learn(s, at, e):
    """Update theta and P by the innovation e and phi, psi.

    Return the residual eps, NaN where a result is not finite, and the share of e^2 that the loss
    counts.
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
    _adapt(s, at, lam)
    return eps, share


@hot
def _account(s, at, y, e, eps, lam, share):
    """Update the running sums, and test for divergence: y_hat much worse than y_hat = 0."""
    s.s1 = lam * s.s1 + 1.0
    s.s2 = lam * lam * s.s2 + 1.0
    s.loss = lam * s.loss + e * e * share
    s.e2 = lam * s.e2 + e * e
    s.eps2 = lam * s.eps2 + eps * eps
    s.y2 = lam * s.y2 + y * y
    s.fast_e2 = FAST * s.fast_e2 + (1.0 - FAST) * e * e
    s.fast_y2 = FAST * s.fast_y2 + (1.0 - FAST) * y * y
    if s.lags > 0.0:
        correlate(at.residuals, at.products, eps, lam)
    s.updates += 1.0
    s.since += 1.0
    now, usual = s.fast_e2 * s.s1, max(s.fast_y2 * s.s1, s.y2) + 1e-4 * s.s1
    if s.diverged == 0.0:
        if s.since > s.warm and now > 4.0 * usual:
            s.diverged = 1.0
    elif s.since > 2.0 * s.warm and now < 2.0 * usual:
        s.diverged = 0.0


@merged
def take(s, at):
    """Take the sample in ``s.y`` and ``at.inputs`` through the recursion."""
    y = s.y * at.factors[0]
    y_hat = expect(s, at)
    e = y - y_hat
    eps = e if s.since > 0.0 else 0.0
    learning = s.filled > s.depth + s.nc
    lam, share = s.lam, 1.0
    if learning:
        eps, share = _learn(s, at, e)
        if not abs(eps) < math.inf:
            s.phase = RESTARTING
            learning = False
    if learning:
        _account(s, at, y, e, eps, lam, share)
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


@hot
def noise_variance(s):
    """Return the variance of the noise e, scaled; NaN before the first update."""
    if s.s1 == 0.0:
        return math.nan
    return s.loss / max(s.s1 - s.n * s.s2 / s.s1, 1.0)


@hot
def covariance_entry(s, at, i, j):
    """Return the covariance of theta[i] and theta[j], i <= j, in the user's units."""
    n = len(at.theta)
    if s.s1 == 0.0:
        return math.nan
    if s.lags > 0.0:
        return at.covariance[i * n + j] * at.units[i] * at.units[j]
    # cov = sigma^2 P S2 / S1: sigma^2 P for lambda = 1, sigma^2 P / (1 + lambda) in steady state
    p = entry_of_p(at.d, at.upper, i, j)
    return noise_variance(s) * p * s.s2 / s.s1 * at.units[i] * at.units[j]
