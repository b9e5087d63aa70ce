"""The filter 1/A(q) over a whole record, compiled or by SciPy, for all methods that need it."""

import numpy as np

from yawid.blocks import Floats
from yawid.estimation.kernel.entry_points import filter_rows
from yawid.estimation.machine.runner import RUNNER


def all_pole(a: Floats, drive: Floats, past: Floats | None = None) -> Floats:
    """Return x(k) of x(k) + a1 x(k-1) + ... = drive(k), for each column of the drive.

    ``a`` (na,) without its leading 1, ``drive`` (n,) or (n, m), ``past`` (na,) or (na, m) the
    values of x before, newest first, all 0 if None; x has the shape of the drive. An unstable
    filter may overflow to values that are not finite.
    """
    x = np.array(drive, np.float64, order="C")
    if not (len(a) and x.size):
        return x
    delays = np.zeros((len(a), *x.shape[1:]))
    if past is not None:
        for i in range(len(a)):
            for j in range(i, len(a)):
                delays[i] -= a[j] * past[j - i]
    if (loop := RUNNER.loop(filter_rows)) is None:
        from scipy.signal import lfilter  # takes as long to load as a short replay

        return np.asarray(lfilter(np.ones(1), np.insert(a, 0, 1.0), x, axis=0, zi=delays)[0])
    loop(a.reshape(-1, 1), delays.reshape(len(a), -1), x.reshape(len(x), -1))
    return x
