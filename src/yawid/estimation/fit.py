"""How well a model explains the measurements: one step ahead, and simulated from the inputs alone.

Both fits are 100 (1 - |y - y_hat| / |y - mean(y)|) in percent. The one-step fit is high for almost
every model, because each prediction starts from measured values; the simulation is more severe.
"""

import numpy as np

from yawid.blocks import Floats, runs_of
from yawid.config.estimator import ArmaxOrders
from yawid.estimation.all_pole import all_pole
from yawid.estimation.polynomials import known_regressors, lag_depth

WORST_PCT = -1000.0
"""Lower limit of a fit."""
TRAINING = 2.0 / 3.0
"""The model as it was after this share of the usable samples is scored on the rest."""
LEAST_SAMPLES = 200
"""With fewer usable samples none are held back."""


def fit_percent(y: Floats, y_hat: Floats) -> float:
    """Return the fit of ``y_hat`` (n,) to ``y`` (n,) in percent, over the rows that have both.

    NaN where y does not change. It is never below -1000 %: for a model that diverges, the exact
    number has no meaning.
    """
    rows = np.isfinite(y) & ~np.isnan(y_hat)
    if rows.sum() < 2:
        return float("nan")
    y, y_hat = y[rows], y_hat[rows]
    spread = float(np.linalg.norm(y - y.mean()))
    if spread == 0.0:
        return float("nan")
    with np.errstate(over="ignore"):
        return max(100.0 * (1.0 - float(np.linalg.norm(y - y_hat)) / spread), WORST_PCT)


def simulate(theta: Floats, orders: ArmaxOrders, bias: bool, u: Floats, y: Floats) -> Floats:
    """Return y (n,) of A(q) y = B(q) u + bias simulated from the inputs, in y's unit.

    ``theta`` (n_theta,), ``u`` (n, inputs), ``y`` (n,). The simulation starts again after every
    held (NaN) sample, from as many measured samples as the lags need: those rows are NaN, as are
    held ones. Rows where the simulation overflows are infinite.
    """
    na, of_c = orders.na, slice(orders.na + sum(orders.nb), orders.na + sum(orders.nb) + orders.nc)
    simulated, lags = np.full(len(y), np.nan), lag_depth(orders)
    drive = known_regressors(u, y, orders, bias)[:, na:] @ np.delete(theta, of_c)[na:]
    for start, stop in runs_of(np.isfinite(y) & np.isfinite(u).all(axis=1)):
        first = min(start + lags, stop)
        with np.errstate(over="ignore", invalid="ignore"):
            free = all_pole(theta[:na], drive[first:stop], y[first - na : first][::-1])
        simulated[first:stop] = np.where(np.isfinite(free), free, np.inf)
    return simulated
