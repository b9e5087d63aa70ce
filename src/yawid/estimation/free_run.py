"""The free run of a model over the stretches of a record, from the initial state that fits best.

It works on scaled signals, as ``prediction_error.py`` does. What an initial state can explain is a
free decay: a combination of the responses of 1/A to past values of 1, one for each lag of A.
"""

import math
from typing import NamedTuple

import numpy as np

from yawid.blocks import Floats
from yawid.estimation.all_pole import all_pole
from yawid.estimation.fit import fit_percent
from yawid.estimation.prediction_error import RIDGE, RecordFit
from yawid.estimation.products import cross


class RudderEffect(NamedTuple):
    """What the rudder adds to a model; NaN is what is not known.

    ``chance`` is the probability of so large a B by noise alone; ``fit_pct`` the free-run fit and
    ``without_pct`` that without the rudder. Where it was asked for, ``shifted_s`` is the shift in
    time, by an eighth of a period or more, at which the same rudder fits best, ``ratio`` the
    sum of squared residuals there over that of the rudder as it was measured, and ``excess`` the
    latter over that of the innovations.
    """

    chance: float
    fit_pct: float
    without_pct: float
    shifted_s: float = math.nan
    ratio: float = math.nan
    excess: float = math.nan


def rudder_fits(record: RecordFit, theta: Floats) -> tuple[float, float]:
    """Return the free-run fits in percent: with the rudder, and without it.

    A is that of ``theta`` (n_theta,). B, bias and initial states are the best ones in both cases,
    so that without the rudder the free decay explains as much as it can.
    """
    rest, of_rudder = _driven(record, theta, 0), record.orders.nb[0]
    fits = []
    for columns in (rest[:, 1:], rest[:, 1 + of_rudder :]):
        eps = without(columns, rest[:, :1])[:, 0]
        fits.append(fit_percent(record.y, record.y - eps) if np.isfinite(eps).all() else math.nan)
    return fits[0], fits[1]


def best_shift(record: RecordFit, theta: Floats, least: int, most: int) -> tuple[int, float, float]:
    """Return the shift of the rudder in samples that fits best, its loss and that of no shift.

    Shifts of ``least`` to ``most`` samples either way are tried, half of ``least`` apart. A is that
    of ``theta`` (n_theta,), all else is fitted again. A rudder that did not move the
    aircraft has no reason to fit best at the time at which it was measured.
    """
    losses = {}
    later = range(least, most + 1, max(1, least // 2))
    for shift in (0, *later, *(-each for each in later)):
        rest = _driven(record, theta, shift)
        losses[shift] = float(np.sum(without(rest[:, 1:], rest[:, :1]) ** 2))
    unshifted = losses.pop(0)
    found = min(losses, key=lambda shift: losses[shift])
    return found, losses[found], unshifted


def _driven(record: RecordFit, theta: Floats, shift: int) -> Floats:
    """Return y and the responses of 1/A to each column of B and to the bias, without free decays.

    The rudder comes ``shift`` samples later; what lies beyond a stretch is as at its end.
    """
    na, known, parts = record.orders.na, record.orders.na + sum(record.orders.nb), []
    rudder = slice(na, na + record.orders.nb[0])
    for y, phi in record.stretches:
        inputs = np.column_stack([phi[:, na:known], np.ones(len(y))])
        rows = np.clip(np.arange(len(y)) - shift, 0, len(y) - 1)
        inputs[:, : record.orders.nb[0]] = phi[rows, rudder]
        responses = all_pole(theta[:na], inputs, np.zeros((na, inputs.shape[1])))
        decays = free_decays(theta[:na], len(y))
        parts.append(without(decays, np.column_stack([y, responses])))
    return np.concatenate(parts)


def free_decays(a: Floats, n: int) -> Floats:
    """Return the responses (n, na) of 1/A, ``a`` (na,), to a past value of 1, each lag in turn."""
    return all_pole(a, np.zeros((n, len(a))), np.eye(len(a)))


def without(columns: Floats, x: Floats) -> Floats:
    """Return x (n, m) less what a combination of the columns (n, l) explains of it."""
    return x - cross(columns.T, coefficients(columns, x))


def coefficients(columns: Floats, x: Floats) -> Floats:
    """Return the combination (l, m) of the columns (n, l) that is nearest to x (n, m)."""
    size = np.sqrt(np.maximum(np.diag(cross(columns, columns)), np.finfo(float).tiny))
    scaled = columns / size
    power = cross(scaled, scaled) + RIDGE * np.eye(len(size))
    found: Floats = np.linalg.solve(power, cross(scaled, x)) / size[:, None]
    return found
