"""The start fit: one Gauss-Newton prediction-error fit of the samples in the window.

It works on scaled samples and gives the recursion its first theta and P.
"""

from dataclasses import dataclass

import numpy as np

from yawid.blocks import Floats
from yawid.config.estimator import EstimatorConfig
from yawid.estimation.machine.products import cross
from yawid.estimation.methods import METHODS
from yawid.estimation.prediction_error import RecordFit, stretches_of


@dataclass(frozen=True)
class Start:
    """Result of the start fit on scaled signals: theta (n,), P and theta's covariance (n, n)."""

    theta: Floats
    P: Floats
    covariance: Floats


def fit_start(config: EstimatorConfig, rows: Floats) -> Start | None:
    """Fit ``rows`` (window, 2 + n_inputs): break flag, y and u, scaled, the oldest first.

    Return None where there are too few samples, or where the loss is not below that of theta = 0.
    """
    fit = RecordFit(config, list(stretches_of(config, rows)))
    if len(fit.y) <= 2 * config.n_theta:
        return None
    with np.errstate(all="ignore"):
        theta = fit.gauss_newton()
        psi, _ = fit.gradient(theta, filtered=METHODS[config.method].filters)
        better = fit.loss(theta) < fit.loss(np.zeros_like(theta))
    P = np.asarray(np.linalg.inv(fit.prior + cross(psi * fit.weights[:, None], psi)), np.float64)
    if not better or not np.isfinite(P).all() or np.linalg.eigvalsh(P)[0] <= 0.0:
        return None
    scores = psi * (fit.weights * np.concatenate(fit.residuals(theta)))[:, None]
    return Start(theta, P, P @ cross(scores, scores) @ P)


def factorise(P: Floats, d: Floats, upper: Floats) -> None:
    """Write the factors of P (n, n) = U D U' to ``d`` (n,) and ``upper`` (n (n - 1) / 2,)."""
    lower = np.linalg.cholesky(P[::-1, ::-1])
    root = lower[::-1, ::-1]
    diagonal = np.diag(root)
    d[:] = diagonal**2
    for j in range(1, len(d)):
        upper[j * (j - 1) // 2 : j * (j + 1) // 2] = root[:j, j] / diagonal[j]
