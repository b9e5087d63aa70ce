"""The physics of a stream of estimates: modes with every sample, the yaw channel once a second.

The yaw channel of eq. 22-23 costs some fifteen times what the modes do, nearly all of it for the
sigma of its numbers. It is worked out at the samples whose index on the grid of vehicle time is a
whole number of seconds and stands until the next: a sixtieth of the memory by default.
"""

from dataclasses import replace

import numpy as np

from yawid.blocks import EstimateBlock, Floats, Ints, ModesBlock, Status
from yawid.config.estimator import ArmaxOrders
from yawid.physics.derivatives import known_rows, with_sigma
from yawid.physics.modes import modes
from yawid.quantities.table import YAW_CHANNEL


class PhysicsStage:
    """Turns blocks of estimates, cut anywhere, into modes and yaw channel, a row each."""

    def __init__(
        self,
        orders: ArmaxOrders,
        sample_time_s: float,
        *,
        mean_output: bool = False,
        servo_tau_s: float | None = None,
    ) -> None:
        self._orders, self._sample_time_s = orders, sample_time_s
        self._mean_output, self._servo_tau_s = mean_output, servo_tau_s
        self._every = max(1, round(1.0 / sample_time_s))
        self._standing = np.full((2, len(YAW_CHANNEL)), np.nan)

    def of(self, k: Ints, estimates: EstimateBlock) -> ModesBlock:
        """Return the modes of estimates with their covariance; ``k`` (n,) indices on the grid."""
        block = modes(estimates, self._orders, self._sample_time_s, mean_output=self._mean_output)
        warming_up = estimates.status == Status.WARMING_UP
        due = np.flatnonzero((k % self._every == 0) | warming_up)
        rows = np.concatenate([self._standing[None], self._yaw_rows(estimates, due)])
        newest = np.searchsorted(due, np.arange(len(k)), side="right")
        self._standing = rows[newest[-1]]
        return replace(block, yaw=rows[newest, 0], yaw_std=rows[newest, 1])

    def _yaw_rows(self, estimates: EstimateBlock, due: Ints) -> Floats:
        """Return value and sigma (m, 2, 9) of the rows due; NaN where eq. 23 does not hold."""
        rows = np.full((len(due), 2, len(YAW_CHANNEL)), np.nan)
        worth = estimates.status[due] != Status.WARMING_UP
        if estimates.covariance is not None and worth.any():
            values, std, error = with_sigma(
                estimates.theta[due[worth]], estimates.covariance[due[worth]], self._orders,
                self._sample_time_s, mean_output=self._mean_output, servo_tau_s=self._servo_tau_s,
            )  # fmt: skip
            known = known_rows(values, std, error)[:, None, None]
            numbers = np.stack([values, std], axis=1)
            # Always the same NaN: files are compared to the bit.
            rows[worth] = np.where(known & np.isfinite(numbers), numbers, np.nan)
        return rows
