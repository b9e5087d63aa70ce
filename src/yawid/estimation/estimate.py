"""What one update returns."""

from __future__ import annotations

import numpy as np

from yawid.blocks import Floats, Status
from yawid.estimation.kernel import entry_points as entry
from yawid.estimation.kernel import state as slots


class Estimate:
    """A snapshot after one sample; its fields are computed when asked for."""

    __slots__ = ("_saved",)

    def __init__(self, saved: bytes) -> None:
        self._saved = saved

    @property
    def _state(self) -> Floats:
        return np.frombuffer(self._saved).copy()  # the compiled code reads writable arrays only

    def _read(self) -> Floats:
        state = self._state
        row = np.empty(2 * int(slots.named(state).n) + 5)
        entry.read(state, row)
        return row

    @property
    def theta(self) -> Floats:
        """Parameters (n,) in the user's units."""
        row = self._read()
        return row[: (len(row) - 5) // 2]

    @property
    def theta_std(self) -> Floats:
        """Standard deviation (n,) of theta; NaN before the first update."""
        row = self._read()
        return row[(len(row) - 5) // 2 : -5]

    @property
    def covariance(self) -> Floats:
        """Covariance (n, n) of theta."""
        return covariance(self._state)

    @property
    def y_hat(self) -> float:
        """One-step prediction of y; NaN where there was none."""
        return float(self._read()[-5])

    @property
    def innovation(self) -> float:
        """The error a priori, y - y_hat."""
        return float(self._read()[-4])

    @property
    def residual(self) -> float:
        """The error a posteriori, y - phi' theta(k)."""
        return float(self._read()[-3])

    @property
    def noise_std(self) -> float:
        """Standard deviation of the innovation."""
        return float(self._read()[-2])

    @property
    def status(self) -> Status:
        """What the estimator says of itself."""
        return Status(int(slots.named(self._state).status))

    def __repr__(self) -> str:
        return (
            f"Estimate(theta={self.theta}, theta_std={self.theta_std}, status={self.status.name})"
        )


def covariance(state: Floats) -> Floats:
    """Return the covariance (n, n) of theta in the user's units."""
    n = int(slots.named(state).n)
    row = np.empty(2 * n + 5 + n * n)
    entry.read(state, row)
    return row[2 * n + 5 :].reshape(n, n)
