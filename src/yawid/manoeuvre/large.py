"""Large motion as an input of its own, so that the poles are those of small motion.

A fit is proportional: twice the rudder makes twice the yaw rate. A yaw damper that reaches its
limits is not, nor is an aircraft whose stability changes with sideslip, and the poles of a
proportional fit are between those of small and of large motion. What they add is a feedback of the
yaw rate r that is 0 as long as r is small, so it has the aircraft's own poles:

    r(s) = G(s) delta(s) + G_c(s) c(s),   c = r - min(max(r, -l), l),   l = LARGE max |r|

with free residues of G_c. r in c is the proportional fit's, simulated from the rudder: it has none
of the noise, so that gusts do not look like a part of it. BIC decides whether c belongs to a
manoeuvre; then G is the answer's, and the proportional fits keep their weight, which is small.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from yawid.blocks import Floats
from yawid.manoeuvre.fit import Fit, best_alone, refitted
from yawid.physics.responses import LEAST_BLOCKS, Blocks

LARGE: Final = 0.4
"""The part of the largest yaw rate up to which motion is small. The third power of r in place of c
refused no other manoeuvre, but in linear aircraft zeta was .021 off instead of .019. Without c the
damping of four aircraft with such dampers was 1.5 to 2.9 sigma off. Chosen on 107 flights of these
four and on 120 of the seed 8201."""


def small_motion(fits: Sequence[Fit]) -> list[Fit]:
    """Return the same fits with large motion as a further input, none where BIC is against it."""
    if (best := best_alone(fits)) is None:
        return []
    record = best.blocks.record
    wide = replace(record, u=np.column_stack([record.u, beyond_small(best)]))
    blocks = Blocks(wide, best.blocks.q)
    first = refitted(best, blocks)
    if first.bic >= best.bic:
        return []
    return [first if fit is best else refitted(fit, blocks) for fit in fits]


def beyond_small(fit: Fit) -> Floats:
    """Return what the yaw rate (n,) that a fit of yaw rate alone simulates has beyond small."""
    problem, blocks = fit.of_yaw(), fit.blocks
    beta = problem.at(fit.theta).beta[0]
    least = LEAST_BLOCKS * blocks.q
    fine = Blocks(blocks.record, 1, least)
    X = fit.of_yaw(fine).columns(fine.responses(fit.structure.poles(fit.theta)))
    r = X @ beta
    limit = LARGE * float(np.abs(r).max())
    found = np.zeros(len(blocks.record.u))
    runs = blocks.record.runs.tolist()
    rows = np.concatenate([np.arange(a, b) for a, b in runs if b - a >= least])
    found[rows] = r - np.clip(r, -limit, limit)
    return found
