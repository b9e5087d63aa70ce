"""The feedback from yaw rate to rudder, as a yaw damper makes it, and what speaks against it.

Between his movements a pilot's rudder rests, and that of a damper goes on: there its changes are
those of the yaw rate times its gain. A regression that leaves out the samples that fit worst finds
this gain, whatever else moved the rudder. On the flights of an ArduPlane with YAW2SRV_DAMP 0 to 8
it is within 10 % of that of the autopilot's code.

A rudder that mostly feeds back identifies the inverse of the controller with all that the model
lacks: answers were right up to a share of 0.9, and 9 to 12 % too high from 1.3 on.
"""

import math
from operator import itemgetter
from typing import NamedTuple

import numpy as np

from yawid.blocks import Floats, shifted
from yawid.lateral.roll_law import trimmed_regression

KEPT = 0.7
"""The part of the samples that the regression keeps: the others are a pilot's movements."""
LEAST_EXPLAINED = 0.8
"""The part of the rudder's changes in these samples that a feedback explains. It was 0.84 or more
with a damper of YAW2SRV_DAMP 0.5 or more, and 0.2 at most for a negative gain without one."""
PERIOD_SHARE = 0.1
"""The time over which changes are taken, in periods of the mode."""
NEAR_MODE = (0.5, 2.0)
"""Of wn: what is near the mode. With .6 to 1.6 an aircraft under its own damper, answered rightly,
counted as moved mostly by feedback. Carried over from earlier judging."""


class Feedback(NamedTuple):
    """A rudder that feeds back the yaw rate with ``gain``, in its unit per rad/s.

    ``share`` is the root mean square of that part near the mode over that of the rudder.
    """

    gain: float
    share: float


def rate_feedback(
    rudder: Floats, rate: Floats, aileron: Floats, wn_rad_s: float, sample_time_s: float
) -> Feedback | None:
    """Return the feedback against the yaw rate that is in the rudder, None where there is none.

    Rudder, yaw rate and aileron (n,) are not filtered, and NaN where they are unknown.
    """
    step = max(1, round(PERIOD_SHARE * 2.0 * math.pi / (wn_rad_s * sample_time_s)))
    # The rudder of a sample is the mean up to the next one.
    causes = [0.5 * (rate + shifted(rate, -1))]
    if np.isfinite(aileron).any():
        causes.append(aileron)
    changes = np.column_stack([shifted(x, -step) - x for x in (rudder, *causes)])
    changes = changes[np.isfinite(changes).all(axis=1)]
    kept = int(KEPT * len(changes))
    moved = changes[np.argsort(np.abs(changes[:, 0]), kind="stable")]
    if kept < 10 * changes.shape[1] or not moved[:kept, 0].any():
        return None  # a rudder that rests most of the time
    starts = (moved[:kept], changes)
    found = min((trimmed_regression(rows, changes, kept) for rows in starts), key=itemgetter(0))
    gain, explained = float(found[1][0]), found[2]
    if not (gain < 0.0 and explained >= LEAST_EXPLAINED):
        return None
    known = np.isfinite(rudder) & np.isfinite(rate)
    near = [near_mode(x[known], wn_rad_s, sample_time_s) for x in (rate, rudder)]
    return Feedback(gain, -gain * math.sqrt(near[0] / near[1])) if near[1] > 0.0 else None


def near_mode(x: Floats, wn_rad_s: float, sample_time_s: float) -> float:
    """Return the power of x (n,) near the mode, under a Hann window."""
    spectrum = np.fft.rfft((x - x.mean()) * np.hanning(len(x)))
    of_wn = 2.0 * np.pi * np.fft.rfftfreq(len(x), sample_time_s) / wn_rad_s
    near = (of_wn > NEAR_MODE[0]) & (of_wn < NEAR_MODE[1])
    return float(np.sum(np.abs(spectrum[near]) ** 2))
