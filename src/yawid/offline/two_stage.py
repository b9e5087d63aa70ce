"""The procedure that the paper's text describes, with the lags that its listing omits. Eq. 27-33.

1. Take C(q) = 1 and fit ARX by least squares; its residuals are the first eps.
2. Put the lagged eps next to y and u (eq. 32) and fit theta by least squares.
3. Compute eps again by eq. 33, which with eq. 32 is the recursion eps = (A y - B u - bias)/C.
4. Repeat 2 and 3 until theta converges; where it oscillates, take only a share of each step.

The fixed point is that of extended least squares. Convergence is certain where 1/C - 1/2 is
strictly positive real (``polynomials.spr_margin``), and frequent elsewhere; recursive maximum
likelihood has no such condition. Printed slip: the last exponent of B in eq. 29 is -nk-nb+1, as in
eq. 32.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from yawid.blocks import Floats, runs_of, shifted
from yawid.config.estimator import ArmaxOrders
from yawid.errors import ConfigError, NotIdentifiable
from yawid.estimation.all_pole import all_pole
from yawid.estimation.checks import checked_samples
from yawid.estimation.fit import fit_percent
from yawid.estimation.polynomials import c_of, known_regressors, reflected, spr_margin

MOST_ROUNDS = 500
"""The most rounds of steps 2 and 3."""
STILL = 1e-7
"""theta has converged where a round would move it by at most this share of its sigma."""
SMALLEST_SHARE = 0.1
"""The smallest share of a step that is taken."""
NOISELESS = 1e-9
"""ARX residuals up to this share of y are rounding errors: C stays 1, with infinite sigma."""
RCOND = 1e-12
"""Relative size of singular values that count as 0."""


@dataclass(frozen=True, slots=True)
class TwoStage:
    """Result of the procedure: theta, the ARX fit before it, and the number of rounds.

    ``theta`` (n,) is [a1.., b1.. of each input, c1.., bias]; ``arx`` is the same without c.
    ``theta_std`` (n,) is the sigma of the last least squares, too small where C is not 1.
    ``residual`` (samples,) in y's unit is NaN where lags are missing, ``noise_std`` is its standard
    deviation, ``one_step_pct`` the fit in percent, ``spr_margin`` as in ``polynomials``.
    """

    theta: Floats
    theta_std: Floats
    arx: Floats
    residual: Floats
    noise_std: float
    one_step_pct: float
    rounds: int
    converged: bool
    spr_margin: float


def two_stage(u: ArrayLike, y: ArrayLike, orders: ArmaxOrders, bias: bool = False) -> TwoStage:
    """Fit A(q) y = B(q) u + C(q) e (+ bias) to a record: y (samples,), u (samples, n_inputs).

    A sample with a NaN is left out, and so are those whose lags reach it.

    Raises:
        ConfigError: a shape is wrong, a value is infinite, or there are too few samples.
        NotIdentifiable: the record does not excite all parameters of these orders.
    """
    u, y = checked_samples(u, y, orders.n_inputs, finite_or_nan=True)
    known, first = known_regressors(u, y, orders, bias), orders.n_theta - orders.nc
    rows = np.isfinite(known).all(axis=1) & np.isfinite(y)
    if rows.sum() <= 2 * known.shape[1] + orders.nc:
        raise ConfigError(f"{rows.sum()} samples with their lags are too few for {orders}")
    arx, std = _least_squares(known[rows], y[rows])
    theta = np.insert(arx, [first] * orders.nc, 0.0)
    eps, rounds, share, last = y - known @ arx, 0, 1.0, np.inf
    spread = float(np.linalg.norm(y[rows]))
    still = orders.nc == 0
    if np.linalg.norm(eps[rows]) <= NOISELESS * spread:  # without noise C cannot be estimated
        std, still = np.insert(std, [first] * orders.nc, np.inf), True
    while not still and rounds < MOST_ROUNDS:
        lagged = [shifted(np.where(rows, eps, 0.0), i + 1) for i in range(orders.nc)]
        phi = np.column_stack([known[:, :first], *lagged, known[:, first:]])
        phi[np.isnan(phi) & rows[:, None]] = 0.0  # an eps before the first row
        target, std = _least_squares(phi[rows], y[rows])
        move = float(np.max(np.abs(target - theta) / std))
        if rounds and move > last:
            share = max(0.5 * share, SMALLEST_SHARE)
        theta = theta + share * (target - theta) if rounds else target
        c_of(theta, orders)[:] = reflected(c_of(theta, orders))
        eps = _residuals(theta, known, y, rows, orders)
        rounds, last, still = rounds + 1, move, move <= STILL
    used = eps[rows]
    noise = float(np.sqrt(used @ used / max(len(used) - len(theta), 1)))
    margin = spr_margin(c_of(theta, orders))
    fit = fit_percent(y, y - eps)
    return TwoStage(theta, std, arx, eps, noise, fit, rounds, still, margin)


def _least_squares(phi: Floats, y: Floats) -> tuple[Floats, Floats]:
    """Return theta (n,) and its sigma from the regressors (rows, n) and y (rows,)."""
    theta, _, rank, _ = np.linalg.lstsq(phi, y, rcond=RCOND)
    if rank < phi.shape[1]:
        raise NotIdentifiable(
            f"the record excites only {rank} of {phi.shape[1]} parameters: lower the orders or "
            "move the input more"
        )
    eps = y - phi @ theta
    variance = np.diag(np.linalg.inv(phi.T @ phi)) * (eps @ eps) / (len(y) - len(theta))
    std = np.sqrt(np.maximum(variance, np.finfo(float).tiny))
    return np.asarray(theta, dtype=np.float64), np.asarray(std, dtype=np.float64)


def _residuals(
    theta: Floats, known: Floats, y: Floats, rows: NDArray[np.bool_], orders: ArmaxOrders
) -> Floats:
    """Return eps (samples,) of eq. 33, from eps = 0 before each run of ``rows``; NaN outside."""
    first = orders.n_theta - orders.nc
    c = c_of(theta, orders)
    eps = y - known @ np.delete(theta, slice(first, first + orders.nc))
    for start, stop in runs_of(rows):
        eps[start:stop] = all_pole(c, eps[start:stop])
    return eps
