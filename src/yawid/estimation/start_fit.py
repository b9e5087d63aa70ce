"""The start fit: one prediction-error fit of the samples in the window (Ljung 1999, 10.2).

It works on scaled samples, and gives the recursion its first theta and P. With the weights w of
forgetting and a small ridge r, theta has the least::

    V   = sum w eps^2 + r theta' theta,   eps = (A y - B u - bias) / C                    (33)
    psi = -d eps / d theta = phi / C
    P   = (sum w psi psi' + r I)^-1,      cov = P (sum w^2 eps^2 psi psi') P
"""

from typing import NamedTuple

import numpy as np

from yawid.blocks import Floats
from yawid.config.estimator import EstimatorConfig
from yawid.estimation.all_pole import all_pole
from yawid.estimation.kernel.recursion import stable
from yawid.estimation.machine.products import cross
from yawid.estimation.polynomials import c_of, known_regressors, lag_depth, reflected

RIDGE = 1e-8
"""Used in place of 1 / P0, a prior that would bias the fit where the noise is small."""
SETTLED = 1e-12
"""The fit stops where a step reduces the loss, or changes theta, by less than this share."""


class Start(NamedTuple):
    """Result of the start fit on scaled signals: theta (n,), P and theta's covariance (n, n)."""

    theta: Floats
    P: Floats
    covariance: Floats


def fit_start(config: EstimatorConfig, rows: Floats, first: Floats) -> Start | None:
    """Fit ``rows`` (window, 2 + n_inputs): break flag, y and u, scaled, the oldest first.

    The search starts at ``first`` (n,), with a C(q) that is stable. Return None where there are too
    few samples, or where the loss is not below that of theta = 0.
    """
    window = _Window(config, rows)
    if len(window.y) <= 2 * config.n_theta:
        return None
    from scipy.optimize import least_squares  # it takes long to load, and few runs need it

    theta = np.where(np.isfinite(first), first, 0.0)
    c_of(theta, config.orders)[:] = reflected(c_of(theta, config.orders))
    limits = {"ftol": SETTLED, "xtol": SETTLED, "gtol": SETTLED}
    with np.errstate(all="ignore"):
        found = least_squares(window.errors, theta, window.slope, **limits)
    weighted = found.jac[: len(window.y)]
    information = cross(weighted, weighted) + RIDGE * np.eye(config.n_theta)
    P = np.asarray(np.linalg.inv(information), np.float64)
    better = found.fun @ found.fun < np.sum((window.root * window.y) ** 2)
    if not better or not np.isfinite(P).all() or np.linalg.eigvalsh(P)[0] <= 0.0:
        return None
    scores = weighted * found.fun[: len(window.y), None]
    return Start(found.x, P, P @ cross(scores, scores) @ P)


class _Window:
    """The samples of the window as stretches between two breaks; short ones are left out."""

    def __init__(self, config: EstimatorConfig, rows: Floats) -> None:
        self.orders, depth = config.orders, lag_depth(config.orders)
        first = self.orders.na + sum(self.orders.nb)
        self.stretches: list[tuple[Floats, Floats]] = []
        for stretch in np.split(rows[:, 1:], np.flatnonzero(rows[:, 0] > 0.0)):
            if len(stretch) - depth > self.orders.nc:
                known = known_regressors(stretch[:, 1:], stretch[:, 0], self.orders, config.bias)
                phi = np.insert(known[depth:], [first] * self.orders.nc, 0.0, axis=1)
                self.stretches.append((stretch[depth:, 0], phi))
        self.y = np.concatenate([np.empty(0), *(y for y, _ in self.stretches)])
        self.root = config.forgetting_factor ** (0.5 * np.arange(len(self.y))[::-1])

    def residuals(self, theta: Floats) -> list[Floats]:
        """Return eps (n,) of each stretch; eps = 0 before it."""
        c = c_of(theta, self.orders)
        return [all_pole(c, y - phi @ theta) for y, phi in self.stretches]

    def errors(self, theta: Floats) -> Floats:
        """Return the terms whose squares add up to V; they are infinite where C is not stable."""
        if not stable(c_of(theta, self.orders).copy()):
            return np.full(len(self.y) + len(theta), np.inf)
        eps = np.concatenate(self.residuals(theta))
        return np.concatenate([self.root * eps, RIDGE**0.5 * theta])

    def slope(self, theta: Floats) -> Floats:
        """Return the derivatives of :meth:`errors` by theta: -psi, and those of the ridge."""
        rows, c = [], c_of(theta, self.orders)
        for (_, known), eps in zip(self.stretches, self.residuals(theta), strict=True):
            phi = known.copy()
            for i, column in enumerate(c_of(phi, self.orders).T):
                column[i + 1 :] = eps[: -i - 1]
            rows.append(all_pole(c, phi))
        psi = self.root[:, None] * np.concatenate(rows)
        return np.vstack([-psi, RIDGE**0.5 * np.eye(len(theta))])


def factorise(P: Floats, d: Floats, upper: Floats) -> None:
    """Write the factors of P (n, n) = U D U' to ``d`` (n,) and ``upper`` (n (n - 1) / 2,)."""
    lower = np.linalg.cholesky(P[::-1, ::-1])
    root = lower[::-1, ::-1]
    diagonal = np.diag(root)
    d[:] = diagonal**2
    for j in range(1, len(d)):
        upper[j * (j - 1) // 2 : j * (j + 1) // 2] = root[:j, j] / diagonal[j]
