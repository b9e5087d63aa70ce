"""A record without what lies outside a band, on a coarser grid.

One causal Butterworth filter for every input and the output does not change the relation between
them: if y = G u, then F y = G F u. The finer grid is that of the samples, so vibration between the
two corners is removed before it could appear as a slow motion. SciPy takes half a second to load,
and is loaded only where a record is narrowed.
"""

from typing import NamedTuple

import numpy as np

from yawid.blocks import Floats, runs_of

ORDER = 2
"""The order of the filter at either end of the band."""


class Narrow(NamedTuple):
    """A band (low, high) in Hz, and how many samples of the grid make one of the coarser grid."""

    band_hz: tuple[float, float]
    every: int


def narrowed(u: Floats, y: Floats, sample_time_s: float, how: Narrow) -> tuple[Floats, Floats]:
    """Return u (m, inputs) and y (m,) of n samples in the band, n // every of them.

    u is the mean over the samples of one interval and y the value at its beginning, as on any grid.
    Where u or y is NaN the filter begins again, in the steady state of the first sample after it.
    """
    from scipy.signal import butter, sosfilt, sosfilt_zi

    ends = zip(how.band_hz[::-1], ("low", "high"), strict=True)
    filters = [butter(ORDER, hz, kind, fs=1.0 / sample_time_s, output="sos") for hz, kind in ends]
    signals = np.column_stack([u, y])
    good = np.asarray(np.isfinite(signals).all(axis=1))
    signals[~good] = np.nan
    for start, stop in runs_of(good):
        for each in filters:
            begin = sosfilt_zi(each)[:, :, None] * signals[start]
            signals[start:stop] = sosfilt(each, signals[start:stop], axis=0, zi=begin)[0]
    rows = len(y) // how.every
    cut = signals[: rows * how.every].reshape(rows, how.every, -1)
    u, y = cut[:, :, :-1].mean(axis=1), cut[:, 0, -1]
    known = np.isfinite(u).all(axis=1)
    return u, np.where(known, y, np.nan)
