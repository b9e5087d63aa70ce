"""Products over a whole record, summed one after the other: the same bits on every machine.

The bits of NumPy's own products depend on the number of threads of its BLAS. On a busy machine such
threads also wait for each other, which takes many times longer than one thread alone.
"""

import numpy as np

from yawid.blocks import Floats
from yawid.estimation.kernel.entry_points import add_products, run_systems
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


def simulated(matrix: Floats, start: Floats, u: Floats) -> Floats:
    """Return what comes out (n, o, v) of v linear systems with the inputs ``u`` (n, m).

    ``matrix`` (o + s, m + s, v) times inputs and states is what comes out, and the next states;
    ``start`` (s, v) are the states of the first row.
    """
    (states, width), whole = start.shape, len(matrix)
    if (loop := RUNNER.loop(run_systems)) is not None:
        places = np.zeros((whole, width))
        out = np.empty((len(u), (whole - states) * width))
        columns = np.concatenate([matrix.reshape(-1, width), start, places])
        loop(columns, np.ascontiguousarray(u), out)
        return out.reshape(len(u), -1, width)
    found, x = np.empty((len(u), whole, width)), start
    parts = np.ascontiguousarray(matrix.swapaxes(0, 1))
    for inputs, row in zip(u, found, strict=True):
        by = np.concatenate([np.repeat(inputs[:, None], width, axis=1), x])
        np.add.reduce(parts * by[:, None], axis=0, out=row, initial=0.0)
        x = row[-states:]
    return found[:, :-states]
