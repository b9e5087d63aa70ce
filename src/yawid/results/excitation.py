"""Where the rudder moved on its own: what verdict, ``yawid inspect`` and advice agree on.

In most autopilot modes the rudder is mixed from the aileron, and a copy teaches nothing about the
rudder: what moves the yaw may as well be the roll that the aileron makes. So only that part of the
rudder counts which no regression on the aileron explains.
"""

from dataclasses import dataclass

import numpy as np

from yawid.blocks import WINDOW_S, Bools, Floats, shifted, strokes, window_of
from yawid.estimation.products import cross

LEAST_STROKE = 0.1
"""Excited is where the rudder's own part covers this much of half its travel within 5 s."""
REACH_S = 0.3
"""The aileron this long before and after may explain the rudder: mixers and pilots lag."""
CHUNK_S = 20.0
"""The mix is found anew in each flight mode, and in every 20 s of it."""
MODE_LATE_S = 1.5
"""A change of mode is seen by the next HEARTBEAT, up to so much later."""
ROWS_PER_LAG = 8
ROUNDING = 1e-12
STILL = 0.006
"""An aileron that moves by less than this is no mixer's: it reacts to what the rudder does."""


@dataclass(frozen=True, slots=True)
class Movement:
    """How far the rudder moved within 5 s, in parts of half its travel, at each sample (n,).

    ``whole`` is the stroke of all of it and ``own`` of what the aileron does not explain, 0 at
    samples that are not used. ``aileron_known`` tells whether there was an aileron to compare with;
    without one ``own`` is ``whole``.
    """

    whole: Floats
    own: Floats
    aileron_known: bool

    @property
    def excited(self) -> Bools:
        """The samples (n,) at the end of five seconds in which the rudder moved on its own."""
        return self.own >= LEAST_STROKE

    @property
    def most_whole(self) -> float:
        """The largest stroke."""
        return float(self.whole.max(initial=0.0))

    @property
    def most_own(self) -> float:
        """The largest stroke of the rudder's own part."""
        return float(self.own.max(initial=0.0))


def excitation(
    rudder: Floats, aileron: Floats, mode: Floats, travel_unit: float, sample_time_s: float
) -> Movement:
    """Return the strokes of ``rudder`` (n,) and of its own part beside ``aileron`` (n,).

    ``mode`` (n,) is the flight mode, NaN where unknown; ``travel_unit`` is what half the rudder's
    travel measures in the unit of ``rudder``; samples that are not used are NaN.
    """
    rudder = rudder / travel_unit
    whole = _strokes(rudder, sample_time_s)
    known = np.isfinite(rudder) & np.isfinite(aileron)
    if not known.any() or float(np.ptp(aileron[known])) == 0.0:
        return Movement(whole, whole, bool(known.any()))
    own = _strokes(own_part(rudder, aileron, mode, sample_time_s), sample_time_s)
    return Movement(whole, np.minimum(own, whole), aileron_known=True)


def own_part(rudder: Floats, aileron: Floats, mode: Floats, sample_time_s: float) -> Floats:
    """Return what a regression on the aileron over ±0.3 s leaves of the rudder, (n,).

    NaN where the rudder or one of the aileron's lags is not known, or the flight mode may have
    changed among them.
    """
    reach = max(1, round(REACH_S / sample_time_s))
    lags = [shifted(aileron, i) for i in range(-reach, reach + 1)]
    columns = np.column_stack([*lags, np.ones(len(rudder))])
    known = np.nan_to_num(mode, nan=-1.0)  # unknown is the same as unknown
    changes = np.cumsum(np.diff(known, prepend=known[:1]) != 0.0).astype(float)
    late = max(reach, round(MODE_LATE_S / sample_time_s))
    same = shifted(changes, reach) == shifted(changes, -late)
    rows = np.flatnonzero(np.isfinite(columns).all(axis=1) & np.isfinite(rudder) & same)
    own = np.full(len(rudder), np.nan)
    least = max(round(CHUNK_S / sample_time_s), ROWS_PER_LAG * columns.shape[1])
    for stretch in np.split(rows, np.flatnonzero(np.diff(changes[rows])) + 1):
        for chunk in np.array_split(stretch, max(1, len(stretch) // least)):
            own[chunk] = rudder[chunk] - columns[chunk] @ mix(columns[chunk], rudder[chunk])
    return own


def mix(columns: Floats, rudder: Floats) -> Floats:
    """Return the coefficients (m,) by which ridge regression makes the rudder of columns (n, m).

    The columns are the aileron's lags and, the last of them, a constant.
    """
    n, m = columns.shape
    ridge = np.full(m, n * STILL**2 + ROUNDING)
    ridge[-1] = ROUNDING
    information = cross(columns, columns) + np.diag(ridge)
    return np.asarray(np.linalg.solve(information, cross(columns, rudder)), np.float64)


def _strokes(x: Floats, sample_time_s: float) -> Floats:
    """Return the stroke within the last 5 s at each sample (n,), 0 where x (n,) is not known."""
    found, used = np.zeros(len(x)), np.isfinite(x)
    if used.any():
        found[used] = strokes(x[used], window_of(sample_time_s))
    return found


def around(excited: Bools, sample_time_s: float) -> Bools:
    """Return the samples (n,) within five seconds before or after an excited one."""
    reach = round(WINDOW_S / sample_time_s)
    edges = np.concatenate([[0], np.cumsum(excited)])
    rows = np.arange(len(excited))
    low, high = np.maximum(rows - reach, 0), np.minimum(rows + reach + 1, len(excited))
    near: Bools = edges[high] > edges[low]
    return near
