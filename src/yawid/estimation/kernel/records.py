"""The loops of the fits over a whole record, which are faster compiled than in NumPy.

Each takes three arrays of two dimensions; ``machine/products.py`` and ``all_pole.py`` have the same
in NumPy and SciPy.
"""

# numba infers the types: float64 arrays and floats.
# mypy: disable-error-code="no-untyped-def, no-untyped-call"
from yawid.estimation.kernel.marks import merged


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


LOOPS = (add_products, filter_rows)
