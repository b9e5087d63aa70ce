"""Where the rudder moved on its own: one definition for verdict, ``yawid inspect`` and advice.

In most autopilot modes the rudder is mixed from the aileron. Such a copy teaches nothing about the
rudder, because the roll that the aileron causes may be what moves the yaw. So only the rudder's own
part counts: what a regression on the aileron does not explain.
"""

from dataclasses import dataclass

import numpy as np

from yawid.blocks import Bools, Floats, shifted, strokes, window_of
from yawid.estimation.machine.products import cross

LEAST_STROKE = 0.1
"""The rudder excites where its own part covers this much of half its travel within 5 s."""
REACH_S = 0.3
"""The aileron up to this many s before and after may explain the rudder: mixers and pilots lag."""
CHUNK_S = 20.0
"""The mix is estimated again in each flight mode, and there about every 20 s."""
MODE_LATE_S = 1.5
"""A change of mode is known with the next HEARTBEAT, up to this many s later."""
ROWS_PER_LAG = 8
"""The least number of samples for each coefficient of a regression."""
ROUNDING = 1e-12
"""A ridge so small that it only keeps the regression solvable."""
STILL = 0.006
"""The ridge as an aileron amplitude: a smaller motion is no mixer's, it reacts to the rudder."""


@dataclass(frozen=True, slots=True)
class Movement:
    """How far the rudder moved in the last 5 s, at each sample (n,), as a part of half its travel.

    ``whole`` is the stroke of the whole rudder, ``own`` the stroke of the part that the aileron
    does not explain; both are 0 at samples that are not used. Without an aileron to compare with
    ``own`` equals ``whole``.
    """

    whole: Floats
    own: Floats

    @property
    def excited(self) -> Bools:
        """Whether the rudder moved enough on its own in the last five seconds, per sample (n,)."""
        return self.own >= LEAST_STROKE


def excitation(
    rudder: Floats, aileron: Floats, mode: Floats, travel_unit: float, sample_time_s: float
) -> Movement:
    """Return the strokes of ``rudder`` (n,) and of the part that ``aileron`` (n,) does not explain.

    ``mode`` (n,) is the flight mode, NaN where unknown; ``travel_unit`` is half the rudder's travel
    in the unit of ``rudder``; samples that are not used are NaN.
    """
    rudder = rudder / travel_unit
    whole = _strokes(rudder, sample_time_s)
    known = np.isfinite(rudder) & np.isfinite(aileron)
    if not known.any() or float(np.ptp(aileron[known])) == 0.0:
        return Movement(whole, whole)
    own = _strokes(own_part(rudder, aileron, mode, sample_time_s), sample_time_s)
    return Movement(whole, np.minimum(own, whole))


def own_part(rudder: Floats, aileron: Floats, mode: Floats, sample_time_s: float) -> Floats:
    """Return the part of the rudder (n,) that a regression on the aileron over ±0.3 s leaves.

    It is NaN where the rudder or one of the aileron's lags is unknown, or where the flight mode may
    have changed between the lags.
    """
    reach = max(1, round(REACH_S / sample_time_s))
    lags = [shifted(aileron, i) for i in range(-reach, reach + 1)]
    columns = np.column_stack([*lags, np.ones(len(rudder))])
    known = np.nan_to_num(mode, nan=-1.0)  # two unknown modes count as the same mode
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
    """Return the ridge regression's coefficients (m,) of the rudder (n,) on columns (n, m).

    The columns are the aileron's lags and, as the last one, a constant.
    """
    n, m = columns.shape
    ridge = np.full(m, n * STILL**2 + ROUNDING)
    ridge[-1] = ROUNDING
    information = cross(columns, columns) + np.diag(ridge)
    return np.asarray(np.linalg.solve(information, cross(columns, rudder)), np.float64)


def _strokes(x: Floats, sample_time_s: float) -> Floats:
    """Return the stroke within the last 5 s at each sample (n,), 0 where x (n,) is unknown."""
    found, used = np.zeros(len(x)), np.isfinite(x)
    if used.any():
        found[used] = strokes(x[used], window_of(sample_time_s))
    return found
