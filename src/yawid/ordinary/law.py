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

LAGS_S = (0.2, 0.35, 0.5)
"""The lags of the differences in s; the law is that of the one that explains the aileron best."""
MEAN_S = 0.2
"""The mean that is taken of all three before: a line between two servo messages is late for their
noise, which without it made gains of 1 and .3 in calm air .67 and .1."""
KEPT = 0.7
"""The part of a window's samples that counts: the others are where a turn begins or ends."""


def law_sums(aileron: Floats, roll: Floats, p: Floats, step_s: float) -> Floats:
    """Return for each lag the sums of products (l, 5, 5) of d2 of da, roll, p, integral, and 1."""
    found = np.zeros((len(LAGS_S), 5, 5))
    each = max(1, round(MEAN_S / step_s))
    columns = np.stack([aileron, roll, p, np.cumsum(roll) * step_s], axis=1)
    sums = np.cumsum(np.pad(columns, ((1, 0), (0, 0))), axis=0)
    signals = (sums[each:] - sums[:-each]) / each
    for i, lag_s in enumerate(LAGS_S):
        m = max(1, round(lag_s / step_s))
        rows = signals[2 * m :] - 2.0 * signals[m:-m] + signals[: -2 * m]
        kept = int(KEPT * len(rows))
        if kept < 10:
            continue
        _, gains, _ = trimmed_regression(rows, rows, kept)
        left = np.abs(rows[:, 0] - rows[:, 1:] @ gains)
        some = rows[np.argsort(left, kind="stable")[:kept]]
        columns = np.column_stack([some, np.ones(kept)])
        found[i] = columns.T @ columns
    return found


def law_of(sums: Floats) -> tuple[Law, float]:
    """Return the law of sums (l, 5, 5), and the part of the aileron that it explains.

    Without one, as of a pilot or of commands of other times, its gains are 0.
    """
    best, explained = Law(), 0.0
    for S in sums:
        power = S[0, 0] - S[0, -1] ** 2 / max(S[-1, -1], 1.0)
        if not power > 0.0:
            continue
        scale = np.sqrt(np.diag(S)[1:]) + 1e-12
        gains = np.linalg.lstsq(S[1:, 1:] / np.outer(scale, scale), S[1:, 0] / scale, 1e-9)[0]
        part = 1.0 - (S[0, 0] - S[0, 1:] @ (gains / scale)) / power
        if part > explained and gains[0] < 0.0:
            roll, rate, integral = (-gains[:3] / scale[:3]).tolist()
            best, explained = Law(roll, rate, integral_gain=integral), part
    return best, float(explained)
