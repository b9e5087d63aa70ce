"""The loop of a fit over a whole record for which NumPy has none as fast."""

# numba infers the types: float64 arrays and floats.
# mypy: disable-error-code="no-untyped-def, no-untyped-call"
from yawid.estimation.kernel.marks import called


@called
def add_products(a, b, out):
    """Add a' b (m, l) of a (n, m) and b (n, l) to out, row after row."""
    for k in range(len(a)):
        for i in range(a.shape[1]):
            for j in range(b.shape[1]):
                out[i, j] += a[k, i] * b[k, j]
