"""A yaw rate from headings alone: coarse and slow, by a constant-velocity Kalman filter.

The state is (yaw, yaw rate), driven by white angular acceleration; the filter is filterpy's.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from yawid.blocks import Floats, Ints

FINE_STD = float(np.deg2rad(0.3))
"""Headings rounded to 0.01 degrees come of a filter that is itself good to a fraction of one."""
WHOLE_DEGREES_STD = float(np.hypot(FINE_STD, np.deg2rad(1.0) / np.sqrt(12.0)))
"""Rounding to whole degrees adds the sigma of a uniform error."""
ACCELERATION_PSD = 1.0
"""Spectral density of the angular acceleration, rad^2/s^3: a small aircraft in manoeuvres."""
LONGEST_S = 2.0
"""A longer silence starts the filter again."""


@dataclass(slots=True)
class HeadingRate:
    """Carries the filter from block to block; ``heading_std`` in rad is that of a heading."""

    heading_std: float = FINE_STD
    _filter: Any = None
    _last_us: int = 0

    def of(self, t_us: Ints, yaw: Floats) -> Floats:
        """Return the yaw rate (n,) in rad/s at times (n,) from the unwrapped yaw (n,), NaN kept."""
        rate = np.full(len(yaw), np.nan)
        for i, (t, angle) in enumerate(zip(t_us.tolist(), yaw.tolist(), strict=True)):
            if not np.isfinite(angle):
                continue
            dt = (t - self._last_us) / 1e6
            if self._filter is None or not 0.0 < dt < LONGEST_S:
                self._filter = _new_filter(angle, self.heading_std)
            else:
                self._step(dt, angle)
                rate[i] = self._filter.x[1, 0]
            self._last_us = t
        return rate

    def _step(self, dt: float, angle: float) -> None:
        kalman = self._filter
        kalman.F = np.array([[1.0, dt], [0.0, 1.0]])
        kalman.Q = ACCELERATION_PSD * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
        kalman.predict()
        kalman.update(angle)


def _new_filter(angle: float, heading_std: float) -> Any:
    from filterpy.kalman import KalmanFilter

    kalman = KalmanFilter(dim_x=2, dim_z=1)
    kalman.x = np.array([[angle], [0.0]])
    kalman.P = np.diag([heading_std**2, 1.0])
    kalman.H = np.array([[1.0, 0.0]])
    kalman.R = np.array([[heading_std**2]])
    return kalman
