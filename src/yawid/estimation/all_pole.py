"""The filter 1/A(q) over a whole record, compiled or by SciPy, for all methods that need it."""

from functools import cache
from importlib.machinery import PathFinder
from importlib.util import find_spec, module_from_spec
from typing import Any

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
        whole = np.concatenate([[1.0], a])
        return np.asarray(_lfilter()(np.ones(1), whole, x, 0, delays)[0])
    loop(a.reshape(-1, 1), delays.reshape(len(a), -1), x.reshape(len(x), -1))
    return x


@cache
def _lfilter() -> Any:
    """Return SciPy's filter by importing only its part in C.

    Importing all of scipy.signal takes half as long as a short replay without compiled code, the
    first one of an installation. It happens only where a SciPy keeps that part elsewhere.
    """
    scipy = find_spec("scipy")
    places = (scipy and scipy.submodule_search_locations) or []
    found = PathFinder.find_spec("_sigtools", [f"{each}/signal" for each in places])
    if found is not None and found.loader is not None:
        part = module_from_spec(found)
        found.loader.exec_module(part)
        if hasattr(part, "_linear_filter"):
            return part._linear_filter
    from scipy.signal import lfilter

    return lfilter
