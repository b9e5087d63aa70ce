"""The roll law of an autopilot, by sums that windows add up.

    da = -kf roll - kp p - ki (integral of roll) + a     a: what is asked for, above all the turns

A bank that is asked for as a ramp vanishes in second differences over a lag,

    d2 x(k) = x(k + m) - 2 x(k) + x(k - m)

and what is left of a, where a turn begins or ends, is trimmed: of each window the samples count
that its own regression fits best. First differences made the law 7 % low.

The integral is that of an autopilot's rate loop, which integrates the roll rate that it misses: the
roll angle. A hold of the course looks like one, too, for the course is the integral of the roll.
Without it PX4's law in gusts had a gain of p of -.2 for .18, and a 737's wn was 8 and 12 % high.
"""

import numpy as np

from yawid.blocks import Floats
from yawid.lateral.model import Law
from yawid.lateral.roll_law import trimmed_regression

LAG_S = 0.5
"""The lag of the differences in s. Of 93 flights one of .2 explained the aileron best in 1, and one
of .35 in 12: by .01 more than this, at most."""
MEAN_S = 0.2
"""The mean that is taken of all three before: a line between two servo messages is late for their
noise, which without it made gains of 1 and .3 in calm air .67 and .1."""
KEPT = 0.7
"""The part of a window's samples that counts: the others are where a turn begins or ends."""


def law_sums(aileron: Floats, roll: Floats, p: Floats, step_s: float) -> Floats:
    """Return the sums of products (4, 4) of d2 of da, roll, p and the integral."""
    each, m = (max(1, round(x / step_s)) for x in (MEAN_S, LAG_S))
    columns = np.stack([aileron, roll, p, np.cumsum(roll) * step_s], axis=1)
    sums = np.cumsum(np.pad(columns, ((1, 0), (0, 0))), axis=0)
    signals = (sums[each:] - sums[:-each]) / each
    rows = signals[2 * m :] - 2.0 * signals[m:-m] + signals[: -2 * m]
    kept = int(KEPT * len(rows))
    _, gains, _ = trimmed_regression(rows, rows, kept)
    left = np.abs(rows[:, 0] - rows[:, 1:] @ gains)
    some = rows[np.argsort(left, kind="stable")[:kept]]
    return np.asarray(some.T @ some, np.float64)


def law_of(sums: Floats) -> tuple[Law, float]:
    """Return the law of sums (4, 4), and the part of the aileron that it explains.

    No roll hold flies with a gain of the roll below 0: then the aileron's sign is wrong, or the
    part is small, as of a pilot or of commands of other times.
    """
    scale = np.sqrt(np.diag(sums)) + 1e-12
    products = sums / np.outer(scale, scale)
    gains = np.linalg.lstsq(products[1:, 1:], products[1:, 0], 1e-9)[0]
    roll, rate, integral = (-gains * scale[0] / scale[1:]).tolist()
    return Law(roll, rate, integral_gain=integral), float(products[0, 1:] @ gains)
