"""A record as a fit needs it: inputs that are held over each sample.

A model takes each u(k) for held over its sample. The mean over the sample has the
right area, and the right time of every step; but a step at the share a of a sample is spread over
two instants, by a (1 - a) Ts^2 in its second moment. On average that damps the input by
1 - (w Ts)^2 / 12: at half a radian a sample the mode of a simulated aircraft was 2 % too slow, and
its zeta .03 too large. A part of the step, put before it and after it, takes the moment off again.
"""

import numpy as np

from yawid.blocks import Bools, Floats

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
