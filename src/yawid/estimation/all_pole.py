"""1/A(q) over a whole record, for every method that needs it."""

import numpy as np

from yawid.blocks import Floats
from yawid.estimation.machine.loops import over_a


def all_pole(a: Floats, drive: Floats, past: Floats) -> Floats:
    """Return x of x(k) + a1 x(k-1) + ... = drive(k), of each column where there are several.

    ``a`` (na,) without its leading 1, ``drive`` (n,) or (n, m), ``past`` (na,) or (na, m) the x
    before, newest first. A filter that is not stable overflows to values that are not finite.
    """
    x = np.concatenate([past[::-1], drive])
    over_a(np.ascontiguousarray(a), x[:, None] if x.ndim == 1 else x)
    return x[len(past) :]
