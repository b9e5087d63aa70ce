"""What the reference engine says of its estimate."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from yawid.blocks import Floats, Status
from yawid.estimation.readings import Readings
from yawid.estimation.reference.sums import Spread, Sums
from yawid.estimation.whiteness import ljung_box


@dataclass(frozen=True, slots=True)
class ReferenceEstimate:
    """A snapshot after one sample, as :class:`yawid.Estimate`."""

    theta: Floats
    theta_std: Floats
    covariance: Floats
    y_hat: float
    innovation: float
    residual: float
    noise_std: float
    status: Status


class ReferenceReadings(Readings):
    """The read-outs of :class:`RecursiveArmax`, from filterpy's state and the running sums."""

    status: Status
    _filter: Any
    _sums: Sums
    _spread: Spread
    _factors: Floats
    _units: Floats
    _last: tuple[float, float, float]

    def estimate(self) -> ReferenceEstimate:
        """Return a snapshot."""
        status, covariance = self.status, self.covariance
        std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        std[np.isnan(np.diag(covariance))] = math.nan
        return ReferenceEstimate(self.theta, std, covariance, *self._last, self.noise_std, status)

    @property
    def theta(self) -> Floats:
        """Parameters (n,) in the user's units."""
        return np.asarray(self._filter.x[:, 0] * self._units, dtype=np.float64)

    @property
    def theta_std(self) -> Floats:
        """Standard deviation (n,) of theta."""
        return self.estimate().theta_std

    @property
    def P(self) -> Floats:
        """P (n, n) in the user's units, not multiplied by the noise variance."""
        units = self._units * self._factors[0]
        return np.asarray(self._filter.P * np.outer(units, units), dtype=np.float64)

    @property
    def covariance(self) -> Floats:
        """Covariance (n, n) of theta in the user's units; NaN before the first update."""
        sums = self._sums
        if not sums.s1:
            return np.full((self.config.n_theta,) * 2, math.nan)
        covariance = self._spread.covariance
        if not self.config.residual_lags:
            noise = sums.noise_variance(self.config.n_theta)
            covariance = noise * self._filter.P * sums.s2 / sums.s1
        return np.asarray(covariance * np.outer(self._units, self._units), np.float64)

    @property
    def noise_std(self) -> float:
        """Standard deviation of the noise e, in y's unit; NaN where its loss is below 0."""
        variance = self._sums.noise_variance(self.config.n_theta)
        return math.sqrt(variance) / float(self._factors[0]) if variance >= 0.0 else math.nan

    @property
    def innovation_std(self) -> float:
        """Root mean square of the innovation."""
        return self._sums.root_mean(self._sums.e2) / float(self._factors[0])

    @property
    def residual_std(self) -> float:
        """Root mean square of the residual."""
        return self._sums.root_mean(self._sums.eps2) / float(self._factors[0])

    @property
    def whiteness_p(self) -> float:
        """Ljung-Box p-value that the residuals are white; NaN while unknown."""
        return ljung_box(self._sums.products, self._sums.s1, self._sums.s2)
