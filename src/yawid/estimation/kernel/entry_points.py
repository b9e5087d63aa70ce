"""What is called from outside: take samples, read a row of results; the loops of the fits."""

# numba infers the types: float64 arrays and floats.
# mypy: disable-error-code="no-untyped-def, no-untyped-call"
import math

from yawid.blocks import INNOVATION, NOISE_STD, RESIDUAL, SCALARS, STATUS, Y_HAT
from yawid.estimation.kernel.recursion import covariance_entry, noise_variance, take
from yawid.estimation.kernel.state import (
    FULL,
    HOLDING,
    RESTARTING,
    RUNNING,
    WARMING_UP,
    called,
    header,
    hot,
    merged,
    parts,
)


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


# The loops of the fits over a whole record, faster compiled than in NumPy. Each takes three arrays
# of two dimensions; ``machine/products.py`` and ``all_pole.py`` have the same in NumPy and SciPy.


@merged
def add_products(a, b, out):
    """Add a' b to ``out`` (m, l), row after row, for ``a`` (n, m) and ``b`` (n, l)."""
    rest = len(a) % 4
    for k in range(rest):
        for i in range(a.shape[1]):
            for j in range(b.shape[1]):
                out[i, j] += a[k, i] * b[k, j]
    for k in range(rest, len(a), 4):  # four rows at a time: out is read and written less often
        for i in range(a.shape[1]):
            p, q, r, s = a[k, i], a[k + 1, i], a[k + 2, i], a[k + 3, i]
            for j in range(b.shape[1]):
                two = out[i, j] + p * b[k, j] + q * b[k + 1, j]
                out[i, j] = two + r * b[k + 2, j] + s * b[k + 3, j]


@merged
def filter_rows(a, delays, x):
    """Filter each column of ``x`` (n, m) in place by 1/A, ``a`` (na, 1) without its leading 1.

    ``delays`` (na, m) are those of the direct form II transposed, and change as well.
    """
    last = len(a) - 1
    for k in range(len(x)):
        for j in range(x.shape[1]):
            x[k, j] += delays[0, j]
        for i in range(last):
            for j in range(x.shape[1]):
                delays[i, j] = delays[i + 1, j] - a[i, 0] * x[k, j]
        for j in range(x.shape[1]):
            delays[last, j] = 0.0 - a[last, 0] * x[k, j]


@merged
def run_systems(systems, u, out):
    """Run v linear systems, each a column of ``systems`` (rows, v).

    For ``u`` (n, m), ``out`` (n, o v) and s states, a column has a matrix (o + s, m + s) row by
    row, the states at the start, and o + s places. The matrix times inputs and states is what comes
    out, o rows of v, and the next states.
    """
    width, m, states = systems.shape[1], u.shape[1], 0
    o = out.shape[1] // width
    while (o + states) * (m + states + 1) + states < len(systems):
        states += 1
    now = (o + states) * (m + states)
    found = now + states
    for k in range(len(u)):
        for row in range(o + states):
            at, total = row * (m + states), systems[found + row]
            for j in range(width):
                total[j] = 0.0
            for i in range(m):
                part, by = systems[at + i], u[k, i]
                for j in range(width):
                    total[j] += part[j] * by
            for i in range(states):
                part, x = systems[at + m + i], systems[now + i]
                for j in range(width):
                    total[j] += part[j] * x[j]
        for i in range(o):
            for j in range(width):
                out[k, i * width + j] = systems[found + i, j]
        for i in range(states):
            for j in range(width):
                systems[now + i, j] = systems[found + o + i, j]


LOOPS = (add_products, filter_rows, run_systems)
