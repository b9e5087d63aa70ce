"""1/A(q) over a whole record, for every method that needs it."""

import numpy as np

from yawid.blocks import Floats
from yawid.estimation.machine.object_code import ONE_OVER_A
from yawid.estimation.machine.runner import RUNNER


def all_pole(a: Floats, drive: Floats, past: Floats) -> Floats:
    """Return x of x(k) + a1 x(k-1) + ... = drive(k), of each column where there are several.

    ``a`` (na,) without its leading 1, ``drive`` (n,) or (n, m), ``past`` (na,) or (na, m) the x
    before, newest first. A filter that is not stable overflows to values that are not finite.
    """
    x = np.array(drive, dtype=np.float64, order="C", ndmin=1)
    if not (len(a) and x.size):
        return x
    wide, before = (x, past) if x.ndim == 2 else (x[:, None], past[:, None])
    delays = np.zeros((len(a), wide.shape[1]))
    for i in range(len(a)):
        for j in range(i, len(a)):
            delays[i] -= a[j] * before[j - i]
    if (loop := RUNNER.loop(ONE_OVER_A)) is not None:
        loop(np.ascontiguousarray(a), delays, wide)
        return x
    from scipy.signal import lfilter  # its import takes as long as a short replay

    found: Floats = lfilter([1.0], [1.0, *a], wide, axis=0, zi=delays)[0]
    return found.reshape(x.shape)
