"""The procedure that the paper's text describes, with the lags that its listing omits. Eq. 27-33.

1. Take C(q) = 1 and fit ARX by least squares; its residuals are the first eps.
2. Put the lagged eps next to y and u (eq. 32) and fit theta by least squares.
3. Compute eps again by eq. 33, which with eq. 32 is the recursion eps = (A y - B u - bias)/C.
4. Repeat 2 and 3 until theta converges; where it oscillates, take only a share of each step.

The fixed point is that of extended least squares. Convergence is certain where 1/C - 1/2 is
strictly positive real (``polynomials.spr_margin``), and frequent elsewhere; recursive maximum
likelihood has no such condition. Printed slip: the last exponent of B in eq. 29 is -nk-nb+1, as in
eq. 32.

:func:`paper_listing` is the paper's program nhandangARMAX.m as printed, kept to show why its result
has no meaning. It builds ``Phi = [-Y U]'`` without lags: Y(k) is regressed on Y(k) itself. For any
plant theta = [-1, 0] makes y_est = Y, the identity, and least squares find it: the printed A(z) =
1 - 1.0000 z^-1 is this -1, the printed B = 5e-11 and the mean square error 1e-22 are rounding
errors, and the fit of 100 % is that of Y = Y. The second regression adds error1, which is such a
rounding error: its coefficient (printed 4.1402e3) can have any value. Printed slips: ``Phi`` is
used as ``phi``; T, t and the orders of eq. 28 are never used; "equation (7)" means eq. 30.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from yawid.blocks import Floats
from yawid.config.estimator import ArmaxOrders
from yawid.errors import ConfigError, NotIdentifiable
from yawid.estimation.all_pole import all_pole
from yawid.estimation.checks import checked_samples
from yawid.estimation.polynomials import c_of, known_regressors, reflected

MOST_ROUNDS = 500
"""The most rounds of steps 2 and 3."""
STILL = 1e-7
"""theta has converged where a round would move it by at most this share of its sigma."""
SMALLEST_SHARE = 0.1
"""The smallest share of a step that is taken."""
NOISELESS = 1e-9
"""ARX residuals up to this share of y are rounding errors: C stays 1, with infinite sigma."""


@dataclass(frozen=True, slots=True)
class TwoStage:
    """Result of the procedure: theta, and the ARX fit before it.

    ``theta`` (n,) is [a1.., b1.. of each input, c1.., bias]; ``arx`` is the same without c.
    ``theta_std`` (n,) is the sigma of the last least squares, too small where C is not 1.
    ``residual`` (samples,) in y's unit is NaN where lags are missing.
    """

    theta: Floats
    theta_std: Floats
    arx: Floats
    residual: Floats
    converged: bool


def two_stage(u: ArrayLike, y: ArrayLike, orders: ArmaxOrders, bias: bool = False) -> TwoStage:
    """Fit A(q) y = B(q) u + C(q) e (+ bias) to a record: y (samples,), u (samples, n_inputs).

    A sample with a NaN is left out, and so are those whose lags reach it; eps dies away over it.

    Raises:
        ConfigError: a shape is wrong, a value is infinite, or there are too few samples.
        NotIdentifiable: the record does not excite all parameters of these orders.
    """
    u, y = checked_samples(u, y, orders.n_inputs, finite_or_nan=True)
    known, nc = known_regressors(u, y, orders, bias), orders.nc
    c_at = [orders.n_theta - nc] * nc  # where c1.. are inserted into theta
    rows = np.isfinite(known).all(axis=1) & np.isfinite(y)
    if rows.sum() <= 2 * known.shape[1] + nc:
        raise ConfigError(f"{rows.sum()} samples with their lags are too few for {orders}")
    arx, std = _least_squares(known[rows], y[rows])
    theta, eps, share, last = np.insert(arx, c_at, 0.0), y - known @ arx, 1.0, np.inf
    if nc == 0 or np.linalg.norm(eps[rows]) <= NOISELESS * np.linalg.norm(y[rows]):
        return TwoStage(theta, np.insert(std, c_at, np.inf), arx, eps, converged=True)
    # By eq. 32 C stands to eps as B to one more input, which acts from the next sample on.
    with_eps = ArmaxOrders(orders.na, (*orders.nb, nc), 0, (*orders.nk, 1))
    for _ in range(MOST_ROUNDS):
        past = np.column_stack([u, np.where(rows, eps, 0.0)])
        phi = np.nan_to_num(known_regressors(past, y, with_eps, bias)[rows])
        target, std = _least_squares(phi, y[rows])
        move = float(np.max(np.abs(target - theta) / std))
        share = max(0.5 * share, SMALLEST_SHARE) if move > last else share
        theta, last = theta + share * (target - theta), move
        c = c_of(theta, orders)
        c[:] = reflected(c)
        eps = y - known @ np.delete(theta, range(c_at[0], c_at[0] + nc))
        eps = np.where(rows, all_pole(c, np.nan_to_num(eps)), np.nan)  # eq. 33, from eps = 0
        if move <= STILL:
            return TwoStage(theta, std, arx, eps, converged=True)
    return TwoStage(theta, std, arx, eps, converged=False)


def _least_squares(phi: Floats, y: Floats) -> tuple[Floats, Floats]:
    """Return theta (n,) and its sigma from the regressors (rows, n) and y (rows,)."""
    theta, _, rank, _ = np.linalg.lstsq(phi, y, rcond=None)
    if rank < phi.shape[1]:
        raise NotIdentifiable(
            f"the record excites only {rank} of {phi.shape[1]} parameters: lower the orders or "
            "move the input more"
        )
    eps = y - phi @ theta
    variance = np.diag(np.linalg.inv(phi.T @ phi)) * (eps @ eps) / (len(y) - len(theta))
    return np.asarray(theta), np.sqrt(np.maximum(variance, np.finfo(float).tiny))


def paper_listing(u: Floats, y: Floats) -> tuple[Floats, Floats]:
    """Return theta1 (3,) and y_est1 (n,) of the listing for an input U (n,) and an output Y (n,).

    Both regressions are by ``lstsq``, as their matrix may be singular. The mean square error and
    the fit that the paper prints are those of y_est1.
    """
    phi = np.stack([-y, u])
    phi1 = np.vstack([phi, y - phi.T @ np.linalg.lstsq(phi.T, y, rcond=None)[0]])  # error1
    theta1 = np.linalg.lstsq(phi1.T, y, rcond=None)[0]
    return theta1, phi1.T @ theta1
