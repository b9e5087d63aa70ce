"""A model and the samples by which it is judged, of the stream's end or of one manoeuvre."""

from dataclasses import dataclass

import numpy as np

from yawid.blocks import Floats, runs_of
from yawid.config.estimator import ArmaxOrders


@dataclass(frozen=True, slots=True)
class Model:
    """A final model: theta (p,), its covariance (p, p), its orders and its sample time.

    ``same`` says whether estimating again gave exactly the theta in the file.
    """

    theta: Floats
    covariance: Floats
    orders: ArmaxOrders
    sample_time_s: float
    same: bool


@dataclass(frozen=True, slots=True)
class Judged:
    """The rows by which a model is judged: a manoeuvre's, or the newest of the stream.

    Those of the stream are three times its memory or, without forgetting, all (2^19 at most). t
    (n,) in s since boot, u (n, inputs), y, y_hat, simulated, residual (n,); NaN where held.
    """

    t: Floats
    u: Floats
    y: Floats
    y_hat: Floats
    simulated: Floats
    residual: Floats

    def longest_stretch(self) -> slice:
        """Return the rows of the longest stretch without a held sample."""
        good = np.isfinite(self.y) & np.isfinite(self.u).all(axis=1)
        stretches = runs_of(good)
        if not len(stretches):
            return slice(0, 0)
        first, last = stretches[np.argmax(stretches[:, 1] - stretches[:, 0])]
        return slice(int(first), int(last))
