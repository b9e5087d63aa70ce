"""Prediction errors over a record: loss, gradient, and where two methods come to rest.

It works on scaled signals. RML rests where the loss is least, by damped Gauss-Newton steps (Ljung
1999, 10.2); ELS rests at its own fixed point, the root of phi(theta)' eps(theta). The two share
nothing but where they begin.
"""

from collections.abc import Iterator
from functools import cached_property

import numpy as np

from yawid.blocks import Floats
from yawid.config.estimator import EstimatorConfig
from yawid.estimation.all_pole import all_pole
from yawid.estimation.polynomials import c_of, is_stable, known_regressors, lag_depth, reflected
from yawid.estimation.products import along, cross

ITERATIONS = 30
HALVINGS = 10
RIDGE = 1e-8
"""Stands in for P0: that prior is tight where the noise is small, and would bend the fit."""
SETTLED = 1e-12
"""The relative gain in loss below which the fit is done."""
BALANCED = 1e-8
"""Squared part of its own standard deviation by which theta may miss the fixed point."""

Scores = tuple[Floats, Floats, Floats]
"""At theta: the instruments Z (n, n_theta), the slope psi of -eps (n, n_theta), and eps (n,)."""


def stretches_of(config: EstimatorConfig, rows: Floats) -> Iterator[tuple[Floats, Floats]]:
    """Yield y (n,) and the known regressors (n, n_theta), residuals left 0, between breaks."""
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
    """Loss, gradient, Gauss-Newton steps and ELS's fixed point over the stretches of a record."""

    def __init__(self, config: EstimatorConfig, stretches: list[tuple[Floats, Floats]]) -> None:
        self.orders = config.orders
        self.stretches = stretches
        self.y = np.concatenate([y for y, _ in stretches] or [np.empty(0)])
        self.weights = config.forgetting_factor ** np.arange(len(self.y))[::-1]
        self.prior = np.eye(config.n_theta) * RIDGE

    def residuals(self, theta: Floats) -> list[Floats]:
        """Return eps (n,) = (A y - B u - bias) / C of each stretch, from eps = 0 (eq. 33)."""
        c, rest = c_of(theta, self.orders), np.zeros(self.orders.nc)
        return [all_pole(c, y - along(phi, theta), rest) for y, phi in self.stretches]

    def loss(self, theta: Floats, residuals: list[Floats] | None = None) -> float:
        """Return the weighted sum of squared residuals with the ridge's share, or inf."""
        eps = np.concatenate(self.residuals(theta) if residuals is None else residuals)
        loss = float(np.sum(self.weights * eps**2) + theta @ self.prior @ theta)
        return loss if np.isfinite(loss) else np.inf

    def gradient(
        self, theta: Floats, filtered: bool = True, residuals: list[Floats] | None = None
    ) -> tuple[Floats, Floats]:
        """Return psi (n, n_theta), or phi where not filtered, and eps (n,) at theta.

        Here as in the loss ``residuals`` are those at theta, where they are known already.
        """
        residuals = self.residuals(theta) if residuals is None else residuals
        rows = self.regressors(residuals)
        if filtered:
            c, rest = c_of(theta, self.orders), np.zeros((self.orders.nc, len(theta)))
            rows = [all_pole(c, phi, rest) for phi in rows]
        return np.concatenate(rows), np.concatenate(residuals)

    def scores(self, theta: Floats, residuals: list[Floats]) -> Scores:
        """Return psi for the instruments, psi and eps at theta, whose ``residuals`` are known."""
        psi, eps = self.gradient(theta, residuals=residuals)
        return psi, psi, eps

    def pseudo_linear_scores(self, theta: Floats, residuals: list[Floats]) -> Scores:
        """Return phi for the instruments, psi and eps at theta, whose ``residuals`` are known."""
        psi, eps = self.gradient(theta, residuals=residuals)
        return np.concatenate(self.regressors(residuals)), psi, eps

    def regressors(self, residuals: list[Floats]) -> list[Floats]:
        """Return phi (n, n_theta) of each stretch with its residuals (n,) at their lags."""
        full = [phi.copy() for _, phi in self.stretches]
        for phi, eps in zip(full, residuals, strict=True):
            for i, column in enumerate(c_of(phi, self.orders).T):
                column[i + 1 :] = eps[: -i - 1]
        return full

    @cached_property
    def first_guess(self) -> Floats:
        """Theta by Hannan and Rissanen: a long ARX gives eps, then least squares on phi."""
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
        """Return the regressors of a long ARX: the known ones, y and inputs at further lags."""
        orders = self.orders
        ends = np.cumsum([orders.na, *orders.nb])[[nb > 0 for nb in (1, *orders.nb)]]
        newest = phi[:, ends - 1] if orders.na else np.column_stack([y, phi[:, ends[1:] - 1]])
        known = orders.na + sum(orders.nb)
        columns = [phi[:, :known], phi[:, known + orders.nc :]]
        for lag in range(1, order + 1):
            older = np.zeros_like(newest)
            older[lag:] = newest[:-lag]
            columns.append(older)
        return np.hstack(columns)

    def gauss_newton(self, settled: float = SETTLED) -> Floats:
        """Return the theta of least loss that damped Gauss-Newton steps lead to.

        They end when the loss gains a smaller share than ``settled``.
        """
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
            if not better < loss * (1.0 - settled):
                break
            theta, loss, residuals = trial, better, tried
        return theta

    def fixed_point(self, _settled: float = SETTLED) -> Floats | None:
        """Return the theta where extended least squares comes to rest: phi(theta)' eps(theta) = 0.

        Newton's method with psi for the slope of eps, its steps halved until C(q) is stable and the
        imbalance is less: plain passes need not settle where C is far from 1 (Ljung 1977). None
        where none is found.
        """
        theta = self.first_guess
        imbalance, step = self._pseudo_linear_step(theta)
        for _ in range(ITERATIONS):
            for _ in range(HALVINGS):
                trial = theta + step
                if is_stable(c_of(trial, self.orders)):
                    left, next_step = self._pseudo_linear_step(trial)
                    if left < imbalance:
                        break
                step = 0.5 * step
            else:
                return None
            theta, imbalance, step = trial, left, next_step
            if imbalance < BALANCED:
                return theta
        return None

    def _pseudo_linear_step(self, theta: Floats) -> tuple[float, Floats]:
        """Return how far phi' eps is from 0, in squared standard deviations, and Newton's step."""
        residuals = self.residuals(theta)
        phi, psi, eps = self.pseudo_linear_scores(theta, residuals)
        weighted = phi * self.weights[:, None]
        score = cross(weighted, eps) - self.prior @ theta
        noise = float(np.sum(self.weights * eps**2)) / len(eps)
        if not (noise > 0.0 and np.isfinite(psi).all() and np.isfinite(score).all()):
            return np.inf, np.full_like(theta, np.nan)
        left = float(score @ np.linalg.solve(cross(weighted, phi) + self.prior, score)) / noise
        step = np.linalg.solve(cross(weighted, psi) + self.prior, score)
        return left, np.asarray(step, np.float64)


def _least_squares(phi: Floats, y: Floats, prior: Floats) -> Floats:
    return np.asarray(np.linalg.solve(cross(phi, phi) + prior, cross(phi, y)), dtype=np.float64)
