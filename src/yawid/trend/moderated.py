"""Student's t with a vehicle's variance moderated by that of the fleet (Smyth 2004)."""

from typing import Final

import numpy as np
from scipy.special import digamma, stdtr, zeta

from yawid.blocks import Floats

MOST_DOF: Final = 300.0
"""Most degrees of freedom that the fleet may lend to a vehicle."""
_LEAST_DOF: Final = 3.0
"""Least degrees of freedom for a vehicle's variance to count in the fleet's."""
_LEAST_VEHICLES: Final = 3
"""Least number of such vehicles: fewer do not show how vehicles differ, and nothing is lent."""


def prior(s2: Floats, dof: Floats) -> tuple[float, float]:
    """Return the degrees of freedom and the variance that the fleet lends to each vehicle.

    ``s2`` and ``dof`` (v,) are the vehicles' own. Without enough vehicles: 0 and 1.
    """
    known = (dof >= _LEAST_DOF) & (s2 > 0)
    if known.sum() < _LEAST_VEHICLES:
        return 0.0, 1.0
    d = dof[known] / 2.0
    e = np.log(s2[known]) - digamma(d) + np.log(d)
    spread = float(np.var(e, ddof=1) - np.mean(zeta(2.0, d)))
    if spread <= zeta(2.0, MOST_DOF / 2.0):
        d0 = MOST_DOF
    else:
        x = 0.5 + 1.0 / spread  # Newton on trigamma(x) = zeta(2, x) = spread
        for _ in range(20):
            tri = float(zeta(2.0, x))
            x -= tri * (1.0 - tri / spread) / (2.0 * float(zeta(3.0, x)))
        d0 = 2.0 * x
    return d0, float(np.exp(np.mean(e) + digamma(d0 / 2.0) - np.log(d0 / 2.0)))


def moderated(s2: Floats, dof: Floats, lent: tuple[float, float]) -> Floats:
    """Return each vehicle's variance (v,) combined with the fleet's; 1 if neither is known."""
    d = np.where(np.isfinite(s2) & (dof > 0), dof, 0.0)
    total = lent[0] + d
    own = np.where(d > 0, s2, 0.0) * d
    return np.where(total > 0, (lent[0] * lent[1] + own) / np.maximum(total, 1e-9), 1.0)


def two_sided(t: float, dof: float) -> float:
    """Return the probability of a larger |t| by chance, by Student's t with ``dof``."""
    return float(2.0 * stdtr(dof, -abs(t)))
