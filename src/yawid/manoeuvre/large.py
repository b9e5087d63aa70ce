"""Large motion as an input of its own, so that the poles are those of small motion.

A fit is proportional: twice the rudder makes twice the yaw rate. A yaw damper that reaches its
limits is not, nor is an aircraft whose stability changes with sideslip, and the poles of a
proportional fit are between those of small and of large motion. What they add is a feedback of the
yaw rate r that is 0 as long as r is small, so it has the aircraft's own poles:

    r(s) = G(s) delta(s) + G_c(s) c(s),   c = r - min(max(r, -l), l),   l = LIMITS max |r|

with free residues of G_c. r in c is the proportional fit's, simulated from the rudder: it has none
of the noise, so that gusts do not look like a part of it. BIC decides whether c belongs to a
manoeuvre; then G is the answer's. The limit l is not known either, so the best structure is fitted
with each of LIMITS, and all of these fits have their votes.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from yawid.blocks import Floats
from yawid.manoeuvre.fit import Fit, best_alone, refitted
from yawid.physics.responses import LEAST_BLOCKS, Blocks

LIMITS: Final = (0.4, 0.05, 0.1, 0.2, 0.3, 0.55, 0.7, 0.85)
"""The parts of the largest yaw rate up to which motion may be small; whether there is large motion
is seen with the first. Without c the damping of four aircraft with such dampers was 1.5 to 2.9
sigma off (RMS), with all limits .6 to 1.6. With the first alone a simulated damper with limits at a
tenth of the largest yaw rate left zeta 12 sigma off, with the best alone 3. Chosen on 107 flights
of these four, 120 of the seed 8201 and the tests' damper."""


def small_motion(fits: Sequence[Fit]) -> list[Fit]:
    """Return fits with large motion as a further input, none where BIC is against it.

    The best structure has one for each limit, the others that of the limit with the least BIC.
    """
    if (best := best_alone(fits)) is None:
        return []

    def fitted(limit: float, r: Floats) -> Fit:
        return refitted(best, _with_large(best, r, limit))

    r = simulated_rate(best)
    first = fitted(LIMITS[0], r)
    if first.bic >= best.bic:
        return []
    tried = sorted([first, *(fitted(limit, r) for limit in LIMITS[1:])], key=lambda fit: -fit.bic)
    found = tried[-1].blocks
    return [*tried, *(refitted(fit, found) for fit in fits if fit is not best)]


def _with_large(fit: Fit, r: Floats, limit: float) -> Blocks:
    """Return a fit's blocks with what r (n,) has beyond its limit as a further input."""
    record, most = fit.blocks.record, limit * float(np.abs(r).max())
    u = np.column_stack([record.u, r - np.clip(r, -most, most)])
    return Blocks(replace(record, u=u), fit.blocks.q)


def simulated_rate(fit: Fit) -> Floats:
    """Return the yaw rate (n,) that a fit of yaw rate alone simulates; 0 where it has no blocks."""
    problem, blocks = fit.of_yaw(), fit.blocks
    beta = problem.at(fit.theta).beta[0]
    least = LEAST_BLOCKS * blocks.q
    fine = Blocks(blocks.record, 1, least)
    X = fit.of_yaw(fine).columns(fine.responses(fit.structure.poles(fit.theta)))
    found = np.zeros(len(blocks.record.u))
    runs = blocks.record.runs.tolist()
    rows = np.concatenate([np.arange(a, b) for a, b in runs if b - a >= least])
    found[rows] = X @ beta
    return found
