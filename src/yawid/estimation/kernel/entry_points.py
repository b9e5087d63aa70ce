"""What is called from outside: take samples, read a row of results, restart (always in Python)."""

# numba infers the types: float64 arrays and floats.
# mypy: disable-error-code="no-untyped-def, no-untyped-call"
import math

from yawid.blocks import INNOVATION, NOISE_STD, RESIDUAL, SCALARS, STATUS, Y_HAT, Floats
from yawid.estimation.kernel import state as slots
from yawid.estimation.kernel.marks import called, hot, merged
from yawid.estimation.kernel.recursion import covariance_entry, gather, noise_variance, take
from yawid.estimation.kernel.state import (
    FULL,
    HOLDING,
    RESTARTING,
    RUNNING,
    header,
    parts,
)


@merged
def _sample(s, at):
    """Take one sample: hold it where it is not finite, else recurse or put it into the window."""
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
        gather(at.packed)


@hot
def _finite_or_nan(u, y):
    """Return whether nothing in u (samples * m,) and y (samples,) is infinite."""
    for k in range(len(y)):
        if abs(y[k]) == math.inf:
            return False
    for k in range(len(u)):  # noqa: SIM110 # numba compiles no generators
        if abs(u[k]) == math.inf:
            return False
    return True


@called
def _read(packed, row):
    """Fill a row of an :class:`EstimateBlock` with the results of the last sample.

    The row's length decides whether it holds the covariance of theta.
    """
    s, at = header(packed), parts(packed)
    n = len(at.theta)
    scale, last = 1.0 / at.factors[0], 2 * n + SCALARS
    for i in range(n):
        row[i] = at.theta[i] * at.units[i]
        for j in range(i, n if len(row) > last else i + 1):
            entry = covariance_entry(s, at, i, j)
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
    """Take the samples from index ``first`` on, and write their results to the rows of ``out``.

    ``u`` (samples * m,), ``y`` (samples,). ``out`` has a row for each sample, or one row for the
    last of them, or none. Without samples a single row gets the results of the last sample taken.
    Return the number of samples; the index of a sample after which Python has to release the
    window or to restart; or -1, with nothing taken, where any value is infinite.
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
        if s.phase == FULL or s.phase == RESTARTING:
            return k
        if len(out) == len(y):
            _read(packed, out[k])
    if len(out) > 0 and len(out) != len(y):
        _read(packed, out[0])
    return len(y)


def restart(packed: Floats) -> None:
    """Set theta, P and the statistics to their start values, after a result that is not finite."""
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
