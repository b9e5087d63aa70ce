"""One sample through the recursion, in the order of the page at the top of ``armax.py``.

Paper eq. 28-33; Ljung and Soderstrom (1983), chapter 3. ``s`` is the header of the packed state and
``at`` its parts (``state.py`` names both); y, u and theta are scaled here. First come the updates
of P = U D U' and of theta's covariance, and Jury's test. All is plain Python, which numba compiles
without fastmath, so that both give the same bits.
"""

# numba infers the types: float64 arrays and floats.
# mypy: disable-error-code="no-untyped-def, no-untyped-call"
import math

import numpy as np

from yawid.estimation.kernel.state import (
    DIVERGING,
    HOLDING,
    RESTARTING,
    TRACKING,
    WARMING_UP,
    hot,
    merged,
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


@hot
def clear(part):
    """Set ``part`` (n,) to zero: a loop compiles in a fraction of the time that a slice takes."""
    for i in range(len(part)):
        part[i] = 0.0


@hot
def push(register, start, length, x):
    """Shift x into ``length`` places of the register from ``start`` on, the newest value first.

    Swapping is faster than a call of memmove.
    """
    for i in range(start, start + length):
        x, register[i] = register[i], x


@hot
def bierman(d, upper, psi, lam, gain, most):
    """Update P = U D U' by the regressor psi (n,); return 1 / alpha, alpha = lambda + psi' P psi.

    P becomes (P - P psi psi' P / alpha) / lambda, by Bierman's (1977) method, and ``gain`` (n,)
    becomes P psi, the Kalman gain times alpha. No entry of D grows beyond ``most``.
    """
    over = 1.0 / lam
    alpha, inverse, column = lam, over, 0
    for j in range(len(psi)):
        f = psi[j]
        for i in range(j):
            f += upper[column + i] * psi[i]
        v = d[j] * f
        mu = -f * inverse
        grown = d[j] * over * alpha
        alpha += f * v
        inverse = 1.0 / alpha
        d[j] = min(grown * inverse, most)
        gain[j] = v
        for i in range(j):
            old = upper[column + i]
            upper[column + i] = old + gain[i] * mu
            gain[i] += old * v
        column += j
    return inverse


@hot
def floor(d, upper, k, weight, gain):
    """Add a pseudo-measurement of theta[k] equal to its estimate, with ``weight`` = 1 / variance.

    It reduces P, by Bierman's method again, and leaves theta unchanged. ``gain`` is overwritten.
    """
    alpha, inverse, column = 1.0, 1.0, k * (k - 1) // 2
    for i in range(k):
        gain[i] = 0.0
    for j in range(k, len(d)):
        f = 1.0 if j == k else upper[column + k]
        v = weight * d[j] * f
        mu = -f * inverse
        before = alpha
        alpha += f * v
        inverse = 1.0 / alpha
        d[j] *= before * inverse
        gain[j] = v
        for i in range(j):
            old = upper[column + i]
            upper[column + i] = old + gain[i] * mu
            gain[i] += old * v
        column += j


@hot
def stable(a):
    """Return whether all zeros of z^n + a1 z^(n-1) + ... lie inside the unit circle.

    ``a`` (n,) is overwritten. Jury's test, as a step-down of reflection coefficients.
    """
    if len(a) == 2:
        return abs(a[1]) < 1.0 and abs(a[0]) < 1.0 + a[1]
    for m in range(len(a) - 1, -1, -1):
        k = a[m]
        if not abs(k) < 1.0:
            return False
        rest = 1.0 / (1.0 - k * k)
        for i in range((m + 1) // 2):
            low, high = a[i], a[m - 1 - i]
            a[i] = (low - k * high) * rest
            a[m - 1 - i] = (high - k * low) * rest
    return True


@hot
def follow_covariance(covariance, echo, psi, gain, h, inverse, e, memory):
    """Update the covariance of theta by one innovation e, which may be white or coloured.

    With K = inverse * gain and F = I - K psi' the error of theta is multiplied by F and driven by
    K e, so that, with h = memory * echo,

        cov  <- F cov F' + K e e K' + F h e K' + K e h' F'
        echo <- F h + K e

    ``echo`` (n,) is what earlier innovations left in theta, weighted by memory^lag: this sums the
    autocorrelation of the innovations recursively (after Grauer and Morelli 2016, with a geometric
    window of lags). lambda(k) enters as it was at each update. A step that was halved to keep C(q)
    stable enters as if it were whole; the information floor changes P but not theta, and so does
    not enter. ``covariance`` (n n,), ``psi``, ``gain`` and ``h`` (n,); ``gain`` becomes K and ``h``
    is overwritten.
    """
    n = len(psi)
    quadratic, cross, dot = e * e, 0.0, 0.0
    for i in range(n):
        row = 0.0
        for j in range(n):
            row += covariance[j * n + i] * psi[j]
        quadratic += psi[i] * row
        gain[i] *= inverse
        dot += psi[i] * echo[i]
        h[i] = memory * e * echo[i] - row
    cross = memory * e * dot
    for i in range(n):
        h[i] += gain[i] * (0.5 * quadratic - cross)
        echo[i] = memory * (echo[i] - gain[i] * dot) + gain[i] * e
    for i in range(n):
        for j in range(n):
            covariance[i * n + j] += gain[i] * h[j] + h[i] * gain[j]


@hot
def correlate(residuals, products, eps, lam):
    """Update the running sums of eps(k) eps(k - l), l = 0 to lags: ``products`` (lags + 1,)."""
    products[0] = lam * products[0] + eps * eps
    for i in range(len(residuals)):
        products[i + 1] = lam * products[i + 1] + eps * residuals[i]
    push(residuals, 0, len(residuals), eps)


@hot
def entry_of_p(d, upper, i, j):
    """Return P[i, j] of P = U D U' for i <= j."""
    total = d[j] if i == j else upper[j * (j - 1) // 2 + i] * d[j]
    for k in range(j + 1, len(d)):
        column = k * (k - 1) // 2
        total += upper[column + i] * d[k] * upper[column + j]
    return total


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
