"""A record as a fit needs it: inputs that are held over each sample, a coarser grid, a band.

**Held inputs.** A model takes each u(k) for held over its sample. The mean over the sample has the
right area, and the right time of every step; but a step at the share a of a sample is spread over
two instants, by a (1 - a) Ts^2 in its second moment. On average that damps the input by
1 - (w Ts)^2 / 12: at half a radian a sample the mode of a simulated aircraft was 2 % too slow, and
its zeta .03 too large. A part of the step, put before it and after it, takes the moment off again.

**A band.** One causal Butterworth filter for every input and the output does not change the
relation between them: if y = G u, then F y = G F u. The finer grid is that of the samples, so
vibration between the two corners is removed before it could appear as a slow motion. The filters
are those of scipy.signal, which takes more than half a second to load.
"""

import math
from typing import NamedTuple

import numpy as np

from yawid.blocks import Bools, Floats, runs_of
from yawid.estimation.all_pole import all_pole

MEAN = 1.0 / 12.0
"""The mean of a (1 - a) / 2 over all shares a of a sample."""


def as_held(u: Floats, moves: Bools) -> Floats:
    """Return the inputs (n, inputs) that, held, act as those whose means over samples are ``u``.

    ``moves`` (n,) marks the samples within which an input moved: where in them is unknown. NaN
    stays NaN, and no step is seen next to it.
    """
    steps, near = np.nan_to_num(np.diff(u, axis=0)), moves[1:] | moves[:-1]
    taken = np.zeros((len(u) + 1, u.shape[1]))
    taken[1:-1] = MEAN * steps * near[:, None]
    held: Floats = u + taken[:-1] - taken[1:]
    return held


class Narrow(NamedTuple):
    """A band (low, high) in Hz, and how many samples of the grid make one of the coarser grid."""

    band_hz: tuple[float, float]
    every: int


def narrowed(u: Floats, y: Floats, sample_time_s: float, how: Narrow) -> tuple[Floats, Floats]:
    """Return u (m, inputs) and y (m,) of n samples in the band, n // every of them.

    u is the mean over the samples of one interval and y the value at its beginning, as on any grid.
    Where u or y is NaN the filter begins again, in the steady state of the first sample after it.
    """
    signals = np.column_stack([u, y])
    good = np.asarray(np.isfinite(signals).all(axis=1))
    signals[~good] = np.nan
    for start, stop in runs_of(good):
        low_passed = _filtered(signals[start:stop], how.band_hz[1] * sample_time_s, is_high=False)
        signals[start:stop] = _filtered(low_passed, how.band_hz[0] * sample_time_s, is_high=True)
    rows = len(y) // how.every
    cut = signals[: rows * how.every].reshape(rows, how.every, -1)
    u, y = cut[:, :, :-1].mean(axis=1), cut[:, 0, -1]
    known = np.isfinite(u).all(axis=1)
    return u, np.where(known, y, np.nan)


def _filtered(x: Floats, corner: float, *, is_high: bool) -> Floats:
    """Return x (n, m) by a Butterworth filter of second order, as if x[0] had lasted for ever.

    ``corner`` is its frequency over the rate; it is that of the bilinear transform, ``is_high`` for
    the high-pass.
    """
    k = math.tan(math.pi * corner)
    scale = 1.0 / (1.0 + math.sqrt(2.0) * k + k * k)
    a = np.array([2.0 * (k * k - 1.0), 1.0 - math.sqrt(2.0) * k + k * k]) * scale
    steps = np.concatenate([np.zeros((2, x.shape[1])), x - x[0]])
    middle, gain = (-2.0, scale) if is_high else (2.0, k * k * scale)
    found = all_pole(a, gain * (steps[2:] + middle * steps[1:-1] + steps[:-2]))
    return found if is_high else found + x[0]
