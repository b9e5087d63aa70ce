"""Running sums and theta's covariance for the reference engine, in plain NumPy."""

from __future__ import annotations

import math

import numpy as np

from yawid.blocks import Floats
from yawid.estimation.kernel.state import FAST, FEW


class Sums:
    """Sums of squares and of products of residuals, with the forgetting of the recursion."""

    def __init__(self, lags: int) -> None:
        self.s1 = self.s2 = self.loss = self.e2 = self.eps2 = self.y2 = 0.0
        self.fast_e2 = self.fast_y2 = 0.0
        self.residuals = np.zeros(lags)
        self.products = np.zeros(lags + 1)

    def add(self, y: float, e: float, eps: float, lam: float, share: float) -> None:
        """Add one update; ``share`` is the part of e^2 that the loss counts."""
        self.s1, self.s2 = lam * self.s1 + 1.0, lam * lam * self.s2 + 1.0
        self.loss = lam * self.loss + e * e * share
        self.e2, self.eps2 = lam * self.e2 + e * e, lam * self.eps2 + eps * eps
        self.y2 = lam * self.y2 + y * y
        self.fast_e2 = FAST * self.fast_e2 + (1.0 - FAST) * e * e
        self.fast_y2 = FAST * self.fast_y2 + (1.0 - FAST) * y * y
        lagged = np.array([eps, *self.residuals])
        self.products = lam * self.products + eps * lagged
        self.residuals = lagged[:-1]

    def noise_variance(self, n_theta: int) -> float:
        """Return the variance of the innovation, NaN before the first update."""
        if not self.s1:
            return math.nan
        return self.loss / max(self.s1 - n_theta * self.s2 / self.s1, 1.0)

    def root_mean(self, total: float) -> float:
        """Return the root of a mean square."""
        return math.sqrt(total / self.s1) if self.s1 else math.nan


class Spread:
    """The covariance of theta, the residual's autocorrelation included."""

    def __init__(self, covariance: Floats, lags: int) -> None:
        self.covariance = covariance
        self.echo = np.zeros(len(covariance))
        self.lags = lags

    def follow(self, psi: Floats, gain: Floats, e: float, s1: float) -> None:
        """Take one update: see ``kernel.follow_covariance``, here as the equations stand."""
        memory = 1.0 - min(1.0, max(1.0 / max(self.lags, 1), FEW / (s1 + 1.0)))
        F, drive = np.eye(len(psi)) - np.outer(gain, psi), gain * e
        cross = F @ np.outer(memory * self.echo, drive)
        self.covariance = F @ self.covariance @ F.T + np.outer(drive, drive) + cross + cross.T
        self.echo = memory * (F @ self.echo) + drive
