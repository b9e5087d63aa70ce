"""The batch prediction-error fit: the gold standard that the recursion is compared with.

It minimises the sum of squares of eps = (A y - B u - bias)/C over the whole record (Ljung 1999,
10.2). The fit is the estimator's own start fit, over a window as long as the record.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from yawid.blocks import Floats
from yawid.config.estimator import ArmaxOrders, EstimatorConfig
from yawid.errors import ConfigError, NotIdentifiable
from yawid.estimation.armax import RecursiveArmax
from yawid.estimation.checks import checked_samples
from yawid.estimation.fit import fit_percent, simulate

UNSETTLED = 0.999
"""Lambda that only a fit replaces: a recursion that had to start without one keeps it."""


@dataclass(frozen=True, slots=True)
class PredictionErrorFit:
    """theta (n,) = [a1.., b1.. of each input, c1.., bias] with sigma, covariance (n, n) and noise.

    ``simulation_pct`` is the fit of the model run free from the inputs alone.
    """

    theta: Floats
    theta_std: Floats
    covariance: Floats
    noise_std: float
    simulation_pct: float


def fit_prediction_error(
    u: ArrayLike, y: ArrayLike, orders: ArmaxOrders, bias: bool = False
) -> PredictionErrorFit:
    """Fit A(q) y = B(q) u + C(q) e (+ bias) to a whole record: u (samples, n_inputs), y (samples,).

    A NaN sample is left out and the lags refill after it.

    Raises:
        ConfigError: wrong shapes, an infinite value, or too few samples for these orders.
        NotIdentifiable: a channel does not move, or no fit is better than theta = 0.
    """
    try:
        u, y = checked_samples(u, y, orders.n_inputs)
    except ValueError as error:
        raise ConfigError(str(error)) from error
    if np.isinf(u).any() or np.isinf(y).any():
        raise ConfigError("u and y must not be infinite; a NaN marks a sample to be left out")
    good = np.isfinite(y) & np.isfinite(u).all(axis=1)
    count = int(good.sum())
    if count <= 3 * (orders.n_theta + int(bias)):
        raise ConfigError(f"{count} samples are too few for {orders}")
    if not (np.ptp(u[good], axis=0) > 0.0).all() or not np.ptp(y[good]) > 0.0:
        raise NotIdentifiable("a channel does not move")
    config = EstimatorConfig(
        orders=orders, sample_time_s=1.0, method="rml", bias=bias, start_buffer=count,
        scale_window=1, scale_minimum=0.0, residual_lags=0,
        forgetting_start=UNSETTLED, forgetting_rate=1.0 - 1e-12,
    )  # fmt: skip
    armax = RecursiveArmax(config)
    armax.run(u, y, keep="last")
    if armax.updates == 0 or armax.forgetting_factor != config.forgetting_factor:
        raise NotIdentifiable(f"no fit of {orders}: none beats theta = 0, or gaps leave too little")
    theta, covariance = armax.theta, armax.covariance
    simulated = fit_percent(y, simulate(theta, orders, bias, u, y))
    return PredictionErrorFit(theta, armax.theta_std, covariance, armax.noise_std, simulated)
