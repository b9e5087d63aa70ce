"""Prediction errors over the samples of the start buffer: their loss, its gradient, and its least.

All signals are scaled. The theta of least loss is found by damped Gauss-Newton steps (Ljung 1999,
10.2).
"""

from collections.abc import Iterator
from functools import cached_property

import numpy as np

from yawid.blocks import Floats, Ints
from yawid.config.estimator import EstimatorConfig
from yawid.estimation.all_pole import all_pole
from yawid.estimation.machine.products import along, cross
from yawid.estimation.polynomials import c_of, is_stable, known_regressors, lag_depth, reflected

ITERATIONS = 30
"""The most steps of a fit."""
HALVINGS = 10
"""The most trials of one step, each half the one before."""
RIDGE = 1e-8
"""Used in place of 1 / P0, a prior that would bias the fit where the noise is small."""
SETTLED = 1e-12
"""A fit stops where a step reduces the loss by less than this share."""


def stretches_of(config: EstimatorConfig, rows: Floats) -> Iterator[tuple[Floats, Floats]]:
    """Yield y (n,) and phi (n, n_theta), with its residuals 0, of each stretch between two breaks.

    ``rows`` (samples, 2 + n_inputs): break flag, y, u. Stretches that are too short are left out.
    """
    orders, depth = config.orders, lag_depth(config.orders)
    first = orders.na + sum(orders.nb)
    for stretch in np.split(rows[:, 1:], np.flatnonzero(rows[:, 0] > 0.0)):
        n = len(stretch) - depth
        if n <= orders.nc:
            continue
        known = known_regressors(stretch[:, 1:], stretch[:, 0], orders, config.bias)[depth:]
        phi = np.zeros((n, config.n_theta))
        phi[:, :first], phi[:, first + orders.nc :] = known[:, :first], known[:, first:]
        yield stretch[depth:, 0].copy(), phi


class RecordFit:
    """Loss, gradient and Gauss-Newton fit over the stretches of a record."""

    def __init__(self, config: EstimatorConfig, stretches: list[tuple[Floats, Floats]]) -> None:
        self.orders = config.orders
        self.stretches = stretches
        self.y = np.concatenate([y for y, _ in stretches] or [np.empty(0)])
        self.weights = config.forgetting_factor ** np.arange(len(self.y))[::-1]
        self.prior = np.eye(config.n_theta) * RIDGE

    @cached_property
    def without_c(self) -> Ints:
        """The places in theta of A, B and the bias."""
        first = self.orders.na + sum(self.orders.nb)
        return np.delete(np.arange(len(self.prior)), slice(first, first + self.orders.nc))

    def residuals(self, theta: Floats) -> list[Floats]:
        """Return eps = (A y - B u - bias) / C (n,) of each stretch; eps = 0 before it (eq. 33)."""
        c = c_of(theta, self.orders)
        return [all_pole(c, y - along(phi, theta)) for y, phi in self.stretches]

    def loss(self, theta: Floats, residuals: list[Floats] | None = None) -> float:
        """Return the weighted sum of squared residuals plus the ridge's part; inf if not finite.

        ``residuals`` are those at theta, where the caller has them.
        """
        eps = np.concatenate(self.residuals(theta) if residuals is None else residuals)
        loss = float(np.sum(self.weights * eps**2) + theta @ self.prior @ theta)
        return loss if np.isfinite(loss) else np.inf

    def gradient(
        self, theta: Floats, filtered: bool = True, residuals: list[Floats] | None = None
    ) -> tuple[Floats, Floats]:
        """Return psi (n, n_theta), or phi where not ``filtered``, and eps (n,) at theta.

        ``residuals`` are those at theta, where the caller has them.
        """
        residuals = self.residuals(theta) if residuals is None else residuals
        rows = self.regressors(residuals)
        if filtered:
            c = c_of(theta, self.orders)
            rows = [all_pole(c, phi) for phi in rows]
        return np.concatenate(rows), np.concatenate(residuals)

    def regressors(self, residuals: list[Floats]) -> list[Floats]:
        """Return phi (n, n_theta) of each stretch, with its residuals (n,) in their columns."""
        full = [phi.copy() for _, phi in self.stretches]
        for phi, eps in zip(full, residuals, strict=True):
            for i, column in enumerate(c_of(phi, self.orders).T):
                column[i + 1 :] = eps[: -i - 1]
        return full

    @cached_property
    def first_guess(self) -> Floats:
        """First theta (n_theta,), by Hannan and Rissanen's method.

        A long ARX model gives eps; with it in phi, least squares give theta.
        """
        if not self.orders.nc:
            phi = np.concatenate([phi for _, phi in self.stretches])
            return _least_squares(phi, self.y, self.prior)
        order = min(20, len(self.y) // 10)
        wide = np.concatenate([self._lagged(phi, y, order) for y, phi in self.stretches])
        long = _least_squares(wide, self.y, np.eye(wide.shape[1]) * RIDGE)
        eps = self.y - along(wide, long)
        ends = np.cumsum([len(y) for y, _ in self.stretches])
        full = np.concatenate(self.regressors(np.split(eps, ends[:-1])))
        theta = _least_squares(full, self.y, self.prior)
        c_of(theta, self.orders)[:] = reflected(c_of(theta, self.orders))
        return theta if np.isfinite(theta).all() else np.zeros_like(theta)

    def _lagged(self, phi: Floats, y: Floats, order: int) -> Floats:
        """Return the regressors of a long ARX model: those of phi, and y and u at more lags."""
        orders = self.orders
        ends = np.cumsum([orders.na, *orders.nb])[[nb > 0 for nb in (1, *orders.nb)]]
        newest = phi[:, ends - 1] if orders.na else np.column_stack([y, phi[:, ends[1:] - 1]])
        known = phi[:, self.without_c]
        lagged = np.zeros((len(y), order, newest.shape[1]))
        for lag in range(1, order + 1):
            lagged[lag:, lag - 1] = newest[:-lag]
        return np.hstack([known, lagged.reshape(len(y), -1)])

    def gauss_newton(self) -> Floats:
        """Return the theta (n_theta,) of least loss, found by damped Gauss-Newton steps."""
        theta = self.first_guess
        residuals = self.residuals(theta)
        loss = self.loss(theta, residuals)
        for _ in range(ITERATIONS):
            psi, eps = self.gradient(theta, residuals=residuals)
            weighted = psi * self.weights[:, None]
            information = self.prior + cross(weighted, psi)
            score = cross(weighted, eps) - self.prior @ theta
            if not np.isfinite(information).all():
                break
            step, better = np.linalg.solve(information, score), loss
            for _ in range(HALVINGS):
                trial = theta + step
                if is_stable(c_of(trial, self.orders)):
                    tried = self.residuals(trial)
                    if (better := self.loss(trial, tried)) < loss:
                        break
                step, better = 0.5 * step, loss
            if not better < loss * (1.0 - SETTLED):
                break
            theta, loss, residuals = trial, better, tried
        return theta


def _least_squares(phi: Floats, y: Floats, prior: Floats) -> Floats:
    return np.asarray(np.linalg.solve(cross(phi, phi) + prior, cross(phi, y)), dtype=np.float64)
