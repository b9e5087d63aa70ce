"""How well a model explains the measurements: one step ahead, and simulated from the inputs alone.

Both fits are 100 (1 - |y - y_hat| / |y - mean(y)|) in percent. The one-step fit is high for almost
every model, because each prediction starts from measured values; the simulation is more severe.
"""

import numpy as np

from yawid.blocks import Floats, runs_of
from yawid.config.estimator import ArmaxOrders
from yawid.estimation.all_pole import all_pole
from yawid.estimation.polynomials import lag_depth

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
    simulated = np.full(len(y), np.nan)
    good = np.isfinite(y) & np.isfinite(u).all(axis=1)
    for start, stop in runs_of(good):
        stretch = slice(start, stop)
        simulated[stretch] = _simulate_stretch(theta, orders, bias, u[stretch], y[stretch])
    return simulated


def _simulate_stretch(
    theta: Floats, orders: ArmaxOrders, bias: bool, u: Floats, y: Floats
) -> Floats:
    """Return the simulation (n,) of one stretch without held samples, as :func:`simulate`."""
    lags = lag_depth(orders)
    drive = np.full(len(y), theta[-1] if bias else 0.0)
    first = orders.na
    for i, (nb, nk) in enumerate(zip(orders.nb, orders.nk, strict=True)):
        b = np.concatenate([np.zeros(nk), theta[first : first + nb]])
        drive += np.convolve(u[:, i], b)[: len(y)]
        first += nb
    simulated = np.full(len(y), np.nan)
    past = y[lags - orders.na : lags][::-1]
    with np.errstate(over="ignore", invalid="ignore"):
        free = all_pole(theta[: orders.na], drive[lags:], past)
    simulated[lags:] = np.where(np.isfinite(free), free, np.inf)
    return simulated
