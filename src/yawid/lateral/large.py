"""Large motion as inputs of the airframe, so that its numbers are those of small motion.

The model is linear. A yaw damper that reaches its limits is not, nor is a fin that stalls: each
adds to the linear motion what is 0 as long as the motion is small, as an input c with a factor of
its own, which is sought as start and trims are:

    a - s tanh(a / s), as side force   a fin that loses its effect, s = STALL max |a|
    r - min(max(r, -l), l), as rudder  a damper beyond its limits, l one of LIMITS times max |r|

r and the sideslip a against the air are the predictor's one sample ahead: what gusts add counts,
and both depend on the past alone. With a less c in place of a, the equations of p and r are those
of a plain fin, and that of the sideslip has the slope of c as one more side force.
"""

import math
from collections.abc import Sequence
from copy import copy
from dataclasses import replace

import numpy as np

from yawid.blocks import Floats, Ints
from yawid.estimation.machine.products import cross, simulated
from yawid.lateral.criterion import Part, pair_of
from yawid.lateral.fit import Fit, fit
from yawid.lateral.model import BETA, GUST, RUDDER, TURN_FORCE, R
from yawid.lateral.predictor import innovations
from yawid.lateral.record import Record
from yawid.quantities.airspeed import GRAVITY

STALL, LIMITS = 1.5, np.array([0.1, 0.2, 0.4, 0.7])
"""The shapes that are tried. Where two shapes of a fin were, wn of drawn aircraft was up to 15 %
further off: with the first in the fit, what the second explains is the first one's error."""
INTO, SOUGHT = np.array([(TURN_FORCE, 1), *[(RUDDER, 2)] * len(LIMITS)]).T
"""The inputs to which each c is added, and what is sought of it: its factor, of a damper also its
limit."""
LOST = 1.0 - STALL * math.tanh(1.0 / STALL)
"""The part of the fin's effect that c of the largest sideslip is."""
STEPS = 10
"""The most steps of a fit with a further c: it begins near its end."""
EXPLAINED = 1e-3
"""The least part of c's power that no parameter explains, for c to be seen apart from them."""


def small_motion(best: Fit) -> Fit:
    """Return the fit with each c that BIC asks for, the most likely first; the same without any."""
    its: list[int] = []
    while True:
        pair = pair_of(best.of.theta(best.x[None])[0])
        c = [columns(*each, pair) for each in zip(best.of.records, best.at.parts, strict=True)]
        over = gains(best, c) - SOUGHT * math.log(best.of.count)
        over[its] = -math.inf
        further = [*its, int(over.argmax())]
        if over.max() < 0.0:
            return best
        found = fitted_with(best, [each[:, further] for each in c], INTO[further])
        if best.criterion - found.criterion < SOUGHT[further[-1]] * math.log(best.of.count):
            return best
        best, its = found, further


def fin_lost(found: Fit) -> float:
    """Return the part of the fin's effect that is lost at the largest sideslip."""
    factors = [part.own[8 + len(record.jumps) :][record.large_into == TURN_FORCE].sum()
               for record, part in zip(found.of.records, found.at.parts, strict=True)]  # fmt: skip
    return LOST * float(max(factors))


def columns(record: Record, part: Part, pair: tuple[float, float]) -> Floats:
    """Return each c (n, m) of a record as means over its steps, of a fin as its side force."""
    of, e = part.predictor, part.e[: record.y.size].reshape(-1, 3)
    known = np.column_stack([record.inputs(*pair, part.own[8:]), e, np.ones(len(e))])
    of_e, trim = of.K[0] @ np.linalg.inv(of.whiten[0]), of.trim[0] @ part.own[4:8, None]
    matrix = np.zeros((8, known.shape[1] + 6, 1))
    matrix[[0, 0, 1], [BETA - 6, GUST - 6, R - 6]] = 1.0
    matrix[2:, :, 0] = np.hstack([of.drive[0], of_e, trim, of.Phi[0]])
    start = np.append(part.own[:4], [0.0, 0.0])[:, None]
    a, r = simulated(matrix, start, known)[:, :, 0].T
    s, limits, r = STALL * np.abs(a).max(), LIMITS * np.abs(r).max(), r[:, None]
    fin, damper = a - s * np.tanh(a / s), r - np.clip(r, -limits, limits)
    slope = np.diff(fin, append=fin[-1:]) / record.sample_time_s
    return np.column_stack([
        -slope * record.motion.airspeed_m_s / GRAVITY,
        0.5 * (damper + np.vstack([damper[1:], damper[-1:]])),
    ])  # fmt: skip


def gains(best: Fit, its: Sequence[Floats]) -> Floats:
    """Return by how much the criterion would fall with each c (m,) alone (score test, Rao 1948).

    ``its`` (n, m) are those of each record.
    """
    rows = []
    for record, part, c in zip(best.of.records, best.at.parts, its, strict=True):
        m = c.shape[1]
        into = np.zeros((m, 6, m))
        into[range(m), :, range(m)] = part.predictor.drive[0][:, INTO].T
        x = innovations(part.predictor, c, into, np.zeros((3, m)), np.zeros((6, m)))
        x[record.unused] = 0.0
        x = np.pad(x.reshape(-1, m), ((0, len(record.jumps)), (0, 0)))
        rows.append(x - part.columns @ np.linalg.solve(part.power, cross(part.columns, x)))
    x, variance = np.vstack(rows), best.at.power / best.of.count
    by_others, power = cross(best.slopes, x), np.square(x).sum(axis=0)
    own = power - (by_others * (best.covariance @ by_others)).sum(axis=0) / variance
    return np.where(own > EXPLAINED * power, cross(x, best.at.e) ** 2 / own / variance, 0.0)


def fitted_with(best: Fit, its: Sequence[Floats], into: Ints) -> Fit:
    """Return a fit from where one ended, with these c (n, m) of each record."""
    of = copy(best.of)
    of.fixed, of.records = of.theta(best.x[None])[0], [copy(each) for each in of.records]
    for record, c in zip(of.records, its, strict=True):
        record.large, record.large_into = c, into
    return replace(fit(of, STEPS), settled=best.settled)
