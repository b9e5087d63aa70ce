"""The two loops of a fit over a whole record, for which NumPy has none as fast."""

# numba infers the types: float64 arrays and floats.
# mypy: disable-error-code="no-untyped-def, no-untyped-call"
from yawid.estimation.kernel.marks import called


@called
def one_over_a(a, delays, x):
    """Filter each column of x (n, m) by 1/A(q) in place, in the order of SciPy's ``lfilter``.

    ``a`` (na,) is without its leading 1; ``delays`` (na, m) are those of ``lfilter``, and are used
    up.
    """
    last = len(a) - 1
    for k in range(len(x)):
        for j in range(x.shape[1]):
            y = x[k, j] + delays[0, j]
            for i in range(last):
                delays[i, j] = delays[i + 1, j] - a[i] * y
            delays[last, j] = -a[last] * y
            x[k, j] = y


@called
def add_products(a, b, out):
    """Add a' b (m, l) of a (n, m) and b (n, l) to out, row after row."""
    for k in range(len(a)):
        for i in range(a.shape[1]):
            for j in range(b.shape[1]):
                out[i, j] += a[k, i] * b[k, j]
