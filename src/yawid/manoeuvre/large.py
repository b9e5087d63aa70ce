"""Large motion as an input of its own, so that the poles are those of small motion.

A fit is proportional: twice the rudder makes twice the yaw rate. A yaw damper that reaches its
limits is not, nor is an aircraft whose fin stalls with sideslip, and the poles of a proportional
fit are between those of small and of large motion. What they add is a feedback of the motion that
is 0 as long as it is small, so it has the aircraft's own poles:

    r(s) = G(s) delta(s) + G_c(s) c(s)

    c = r - min(max(r, -l), l)     a damper beyond its limits, l = LIMITS max |r|
    c = b^3,  b = Re(z / p)        a fin that loses its effect

with free residues of G_c. r is the yaw rate that the proportional fit simulates from the rudder,
and z its pair's part: they have none of the noise, so that gusts do not look like a part of c. b is
the angle by which the pair swings the nose, which is its sideslip but for the sign. BIC decides
whether c belongs to a manoeuvre, and which; then G is the answer's. The limit l is not known
either, so the best structure is fitted with each of LIMITS, and all of these fits have their votes.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from yawid.blocks import Floats
from yawid.manoeuvre.fit import Fit, best_alone, refitted
from yawid.manoeuvre.responses import Blocks

LIMITS: Final = (0.4, 0.05, 0.1, 0.2, 0.3, 0.55, 0.7, 0.85)
"""The parts of the largest yaw rate up to which motion may be small; whether there is large motion
is seen with the first, and with b^3. Without c the damping of four aircraft with such dampers was
1.5 to 2.9 sigma off (RMS), with all limits .6 to 1.6. With the first alone a simulated damper with
limits at a tenth of the largest yaw rate left zeta 12 sigma off, with the best alone 3. Chosen on
107 flights of these four, 120 of the seed 8201 and the tests' damper. Without b^3 wn of drawn
aircraft whose fin stalls was 1.6 to 2.0 sigma off in calm air (RMS), with it .6 to 1.2, chosen on
112 of their flights: limits of b instead extrapolated to wn 16 % off."""


def small_motion(fits: Sequence[Fit]) -> list[Fit]:
    """Return fits with large motion as a further input, none where BIC is against it.

    The best structure has one for each c, the others that of the c with the least BIC.
    """
    if (best := best_alone(fits)) is None:
        return []

    def fitted(c: Floats) -> Fit:
        record = best.blocks.record
        u = np.column_stack([record.u, c])
        return refitted(best, Blocks(replace(record, u=u), best.blocks.q))

    r, swing = best.simulated()
    tried = [fitted(swing**3), fitted(_beyond(r, LIMITS[0]))]
    if min(fit.bic for fit in tried) >= best.bic:
        return []
    tried += [fitted(_beyond(r, limit)) for limit in LIMITS[1:]]
    found = min(tried, key=lambda fit: fit.bic).blocks
    return [*tried, *(refitted(fit, found) for fit in fits if fit is not best)]


def _beyond(r: Floats, limit: float) -> Floats:
    """Return what r (n,) has beyond a part of its largest size."""
    most = limit * float(np.abs(r).max())
    return r - np.clip(r, -most, most)
