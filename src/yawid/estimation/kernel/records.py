"""A loop of the fits over a whole record, which is faster compiled than in NumPy."""

# numba infers the types: float64 arrays and floats.
# mypy: disable-error-code="no-untyped-def, no-untyped-call"
from yawid.estimation.kernel.marks import called


@called
def add_products(a, b, out):
    """Add a' b to ``out`` (m, l), row after row, for ``a`` (n, m) and ``b`` (n, l)."""
    for k in range(len(a)):
        for i in range(a.shape[1]):
            for j in range(b.shape[1]):
                out[i, j] += a[k, i] * b[k, j]
