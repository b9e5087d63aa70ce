"""Products of long matrices, summed row after row: the same bits on every machine.

The bits of NumPy's own products depend on the number of threads of its BLAS. On a busy machine such
threads also wait for each other, which takes many times longer than one thread alone.
"""

import numpy as np

from yawid.blocks import Floats
from yawid.estimation.kernel.entry_points import add_products
from yawid.estimation.machine.runner import RUNNER


def cross(a: Floats, b: Floats) -> Floats:
    """Return a' b, (m, l) or (m,), for ``a`` (n, m) and ``b`` (n, l) or (n,)."""
    wide = b[:, None] if b.ndim == 1 else b
    found = np.zeros((a.shape[1], wide.shape[1]))
    if (loop := RUNNER.loop(add_products)) is not None:
        loop(np.ascontiguousarray(a), np.ascontiguousarray(wide), found)
    else:
        # For a single column einsum would sum every fourth row separately.
        twice = np.ascontiguousarray(np.repeat(wide, 2, axis=1) if found.size == 1 else wide)
        sums = np.einsum("ki,kj->ij", np.ascontiguousarray(a), twice)
        found[:] = sums[:, : found.shape[1]]
    return found[:, 0] if b.ndim == 1 else found
