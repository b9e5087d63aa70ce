"""The paper's program nhandangARMAX.m as printed, kept to show why its result has no meaning.

The listing builds ``Phi = [-Y U]'`` without lags: Y(k) is regressed on Y(k) itself. For any plant
theta = [-1, 0] makes y_est = -Y theta1 + U theta2 = Y, the identity, and least squares find it. The
printed A(z) = 1 - 1.0000 z^-1 is this -1, the printed B = 5e-11 is the rounding error of the
inverse, and the mean square error 1e-22 and the fit of 100 % are those of Y = Y. The second
regression adds error1, which is that rounding error: its coefficient (printed 4.1402e3) can have
any value. ``two_stage.py`` is the program with its lags.

Printed slips: ``Phi`` is used as ``phi``; T, t and the orders of eq. 28 are never used; "equation
(7)" in the text around the listing means eq. 30.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from yawid.blocks import Floats
from yawid.estimation.checks import checked_record

SAMPLE_TIME_S = 0.01
"""T of the listing."""


@dataclass(frozen=True, slots=True)
class PaperResult:
    """The variables of the listing, and the numbers that the paper reports from them.

    ``theta`` (2,) of the first regression, ``theta1`` (3,) of the second, ``y_est``, ``y_est1``,
    ``error1``, ``error2`` (n,); ``mse`` the mean square of error2; ``fit_pct`` 100 (1 - |error2| /
    |Y - mean Y|). ``theta1`` may be infinite or NaN, as in the original, where the matrix is
    singular.
    """

    theta: Floats
    theta1: Floats
    y_est: Floats
    y_est1: Floats
    error1: Floats
    error2: Floats
    mse: float
    fit_pct: float


def paper_program(u: ArrayLike, y: ArrayLike) -> PaperResult:
    """Run the listing on an input U and an output Y, (n,) each.

    Raises:
        ConfigError: the two differ in length or are not finite.
    """
    U, Y = checked_record(u, y)
    phi = np.stack([-Y, U])
    theta = _inverse(phi @ phi.T) @ phi @ Y
    y_est = phi.T @ theta
    error1 = Y - y_est
    phi1 = np.stack([-Y, U, error1])
    theta1 = _inverse(phi1 @ phi1.T) @ phi1 @ Y
    y_est1 = phi1.T @ theta1
    error2 = Y - y_est1
    spread = float(np.linalg.norm(Y - Y.mean()))
    with np.errstate(divide="ignore", invalid="ignore"):
        fit = 100.0 * (1.0 - np.float64(np.linalg.norm(error2)) / spread)
    mse = float(np.mean(error2**2))
    return PaperResult(theta, theta1, y_est, y_est1, error1, error2, mse, float(fit))


def _inverse(matrix: Floats) -> Floats:
    """Return the inverse, infinite where the matrix is singular, as MATLAB does."""
    try:
        return np.asarray(np.linalg.inv(matrix))
    except np.linalg.LinAlgError:
        return np.full_like(matrix, np.inf)
