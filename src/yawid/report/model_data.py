"""A model, and the samples that it is judged by: of the stream's end or of one manoeuvre."""

from dataclasses import dataclass

import numpy as np

from yawid.blocks import Floats, runs_of
from yawid.config.estimator import ArmaxOrders


@dataclass(frozen=True, slots=True)
class Model:
    """The final model of the method drawn: theta (p,), its covariance (p, p), what it belongs to.

    ``same`` tells whether estimating again gave the file's own theta to the bit.
    """

    theta: Floats
    covariance: Floats
    orders: ArmaxOrders
    sample_time_s: float
    same: bool


@dataclass(frozen=True, slots=True)
class Judged:
    """The rows the final model is judged by: three times its memory, all where it keeps everything.

    t (n,) in s since boot, u (n, inputs), y, y_hat, simulated, residual (n,); NaN where held.
    """

    t: Floats
    u: Floats
    y: Floats
    y_hat: Floats
    simulated: Floats
    residual: Floats

    def longest_stretch(self) -> slice:
        """Return the rows of the longest stretch in which nothing was held."""
        good = np.isfinite(self.y) & np.isfinite(self.u).all(axis=1)
        stretches = runs_of(good)
        if not len(stretches):
            return slice(0, 0)
        first, last = stretches[np.argmax(stretches[:, 1] - stretches[:, 0])]
        return slice(int(first), int(last))
