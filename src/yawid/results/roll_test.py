"""Whether the residuals follow the roll, which the model leaves out.

Eq. 22 is eq. 21 with the bank angle gamma = 0. Where the aircraft banks as it yaws, by itself or
because somebody holds its wings level, the roll is a further cause of the yaw rate, and one that
follows the rudder. Poles and zeros bend to take it in, so that the residuals may well be white
while wn and zeta are off by more than their sigma.
"""

import numpy as np

from yawid.blocks import Floats, runs_of, shifted
from yawid.config.estimator import EstimatorConfig
from yawid.estimation.all_pole import all_pole
from yawid.estimation.bank import History
from yawid.estimation.polynomials import known_regressors
from yawid.estimation.whiteness import chi_square_tail

NEWEST = 2**14
"""Rows of the history looked at, 14 minutes at 20 Hz: more would cost memory and tell no more."""
ROLL_LAGS = 3
SETTLED = 20
"""Rows of a stretch left out, in which the residuals forget how it began."""


def roll_p(theta: Floats, config: EstimatorConfig, history: History) -> float:
    """Return the p-value that the roll at k-1 to k-3 has no part in the residuals of theta (p,).

    A likelihood-ratio test of the least squares that one Gauss-Newton step is, with and without the
    roll, each sample weighted as the model remembers it. NaN where there are too few samples.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        e, psi, weight = _residuals_and_slopes(theta, config, history)
    e, psi = e * weight, psi * weight[:, None]
    remembered, columns = float(np.sum(weight**2)), psi.shape[1]
    if remembered <= 10 * columns or not (np.isfinite(psi).all() and np.isfinite(e).all()):
        return float("nan")
    scale = np.linalg.norm(psi, axis=0)
    psi = psi / np.where(scale > 0.0, scale, 1.0)
    without, with_roll = (_rest(psi[:, :n], e) for n in (columns - ROLL_LAGS, columns))
    if not with_roll > 0.0:
        return float("nan")
    # With its factor by Box (1949) this is as good as F here, and needs no table.
    factor = remembered - columns + 0.5 * ROLL_LAGS - 1.0
    return chi_square_tail(factor * max(0.0, float(np.log(without / with_roll))), ROLL_LAGS)


def _rest(psi: Floats, e: Floats) -> float:
    """Return the sum of squares that least squares leaves."""
    rest = e - psi @ np.linalg.lstsq(psi, e)[0]
    return float(rest @ rest)


def _residuals_and_slopes(
    theta: Floats, config: EstimatorConfig, history: History
) -> tuple[Floats, Floats, Floats]:
    """Return eps (n,) of eq. 33, its slopes (n, p + 3) with the roll's, and the weights' roots."""
    orders = config.orders
    u, y, roll = (column[-NEWEST:] for column in (history.u, history.y, history.roll))
    known, first = known_regressors(u, y, orders, config.bias), orders.n_theta - orders.nc
    c, rest = theta[first : first + orders.nc], np.zeros(orders.nc)
    rolls = [shifted(roll, i + 1) for i in range(ROLL_LAGS)]
    error = y - known @ np.delete(theta, slice(first, first + orders.nc))
    c_columns = np.zeros((len(y), orders.nc))
    phi = np.column_stack([known[:, :first], c_columns, known[:, first:], *rolls])
    rows = np.isfinite(phi).all(axis=1) & np.isfinite(error)
    used = np.zeros(len(y), bool)
    for start, stop in runs_of(rows):
        stretch = slice(start, stop)
        error[stretch] = all_pole(c, error[stretch], rest)
        for i in range(orders.nc):
            phi[start + i + 1 : stop, first + i] = error[start : max(stop - i - 1, start)]
        phi[stretch] = all_pole(c, phi[stretch], np.zeros((orders.nc, phi.shape[1])))
        used[start + SETTLED : stop] = True
    age = len(y) - 1.0 - np.flatnonzero(used)
    weight: Floats = np.power(config.forgetting_factor, 0.5 * age)
    return error[used], phi[used], weight
