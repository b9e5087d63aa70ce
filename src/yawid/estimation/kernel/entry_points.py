"""What is called from outside: samples and rows of results; a restart, always in Python."""

# numba infers the types: float64 arrays and floats.
# mypy: disable-error-code="no-untyped-def, no-untyped-call"
import math

from yawid.blocks import INNOVATION, NOISE_STD, RESIDUAL, SCALARS, STATUS, Y_HAT, Floats
from yawid.estimation.kernel import state as slots
from yawid.estimation.kernel.forgetting import noise_variance
from yawid.estimation.kernel.linear_algebra import entry_of_p
from yawid.estimation.kernel.marks import called, hot, merged
from yawid.estimation.kernel.recursion import take
from yawid.estimation.kernel.state import (
    FITTING,
    HOLDING,
    RESTARTING,
    RUNNING,
    WARMING_UP,
    header,
    parts,
)


@merged
def _scale(s, at):
    """Set the factors from the full window; False where a channel in use moves too little."""
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
def _collect(packed):
    """Keep the sample in the window; when the window is full and moves, scale it."""
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
        s.phase = FITTING


@merged
def _sample(s, at):
    finite = abs(s.y) < math.inf
    for j in range(len(at.inputs)):
        finite = finite and abs(at.inputs[j]) < math.inf
    if not finite:
        s.held += 1.0
        s.broken = 1.0
        s.y_hat, s.innovation, s.residual, s.status = math.nan, math.nan, math.nan, HOLDING
    elif s.phase >= RUNNING:
        take(s, at)
    else:
        _collect(at.packed)


@hot
def _finite_or_nan(u, y):
    """Tell whether nothing in u (samples M,) and y (samples,) is infinite."""
    for k in range(len(y)):
        if abs(y[k]) == math.inf:
            return False
    for k in range(len(u)):  # noqa: SIM110 # numba compiles no generators
        if abs(u[k]) == math.inf:
            return False
    return True


@hot
def _covariance_entry(s, at, i, j):
    """Covariance of theta[i] and theta[j], i <= j, in the user's units."""
    n = len(at.theta)
    if s.s1 == 0.0:
        return math.nan
    if s.lags > 0.0:
        return at.covariance[i * n + j] * at.units[i] * at.units[j]
    # cov = sigma^2 P S2 / S1: sigma^2 P for lambda = 1, sigma^2 P / (1 + lambda) in steady state
    p = entry_of_p(at.d, at.upper, i, j)
    return noise_variance(s) * p * s.s2 / s.s1 * at.units[i] * at.units[j]


@called
def _read(packed, row):
    """Fill a row of an :class:`EstimateBlock` with what came of the last sample.

    Its length says whether the covariance of theta belongs to it.
    """
    s, at = header(packed), parts(packed)
    n = len(at.theta)
    scale, last = 1.0 / at.factors[0], 2 * n + SCALARS
    for i in range(n):
        row[i] = at.theta[i] * at.units[i]
        for j in range(i, n if len(row) > last else i + 1):
            entry = _covariance_entry(s, at, i, j)
            if i == j:
                row[n + i] = 0.0 if entry < 0.0 else math.sqrt(entry)
            if len(row) > last:
                row[last + i * n + j] = entry
                row[last + j * n + i] = entry
    row[2 * n + Y_HAT], row[2 * n + INNOVATION] = s.y_hat * scale, s.innovation * scale
    row[2 * n + RESIDUAL] = s.residual * scale
    row[2 * n + NOISE_STD] = math.sqrt(noise_variance(s)) * scale
    row[2 * n + STATUS] = s.status


@merged
def run(packed, u, y, out, first):
    """Take samples from the first on into rows of out, or only the last if there is but one row.

    u (samples M,), y (samples,); no sample and one row reads what came of the last one. Returns the
    number of samples taken, or the place of one that leaves something to be done in Python: to
    release the window, to restart. -1, and takes none, where one of them all is infinite.
    """
    if first == 0 and not _finite_or_nan(u, y):
        return -1
    s, at = header(packed), parts(packed)
    m = len(at.inputs)
    for k in range(first, len(y)):
        s.y = y[k]
        for j in range(m):
            at.inputs[j] = u[k * m + j]
        _sample(s, at)
        if s.phase == FITTING or s.phase == RESTARTING:
            return k
        if len(out) == len(y):
            _read(packed, out[k])
    if len(out) > 0 and len(out) != len(y):
        _read(packed, out[0])
    return len(y)


def restart(packed: Floats) -> None:
    """Forget theta, P and the statistics after a sample with a result that was not finite."""
    s, at = slots.named(packed), slots.cut(packed)
    for forgotten in (at.theta, at.upper, at.covariance, at.products):
        forgotten[:] = 0.0
    for known in (at.d, at.least, at.best, at.covariance[:: int(s.n) + 1]):
        known[:] = s.P0
    s.lam = s.lam_start
    s.s1 = s.s2 = s.loss = s.e2 = s.eps2 = s.y2 = s.fast_e2 = s.fast_y2 = 0.0
    s.since, s.broken = 0.0, 1.0
    s.diverged = 1.0
    s.restarts += 1.0
    s.phase, s.status = RUNNING, slots.DIVERGING
