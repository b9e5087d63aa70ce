"""The physics of a stream of estimates: modes at every sample, the yaw channel once a second.

The yaw channel of eq. 22-23 takes about fifteen times as long as the modes, almost all of it for
the sigma of its numbers. It is computed at the samples at whole seconds of vehicle time, and kept
until the next one: a second is a sixtieth of the default memory.
"""

from dataclasses import replace

import numpy as np

from yawid.blocks import EstimateBlock, Floats, Ints, ModesBlock, Status
from yawid.config.estimator import ArmaxOrders
from yawid.physics.derivatives import with_sigma
from yawid.physics.modes import modes
from yawid.quantities.table import YAW_CHANNEL


class PhysicsStage:
    """Computes modes and yaw channel for blocks of estimates, which may have any length."""

    def __init__(
        self,
        orders: ArmaxOrders,
        sample_time_s: float,
        *,
        mean_output: bool = False,
    ) -> None:
        self._orders, self._sample_time_s = orders, sample_time_s
        self._mean_output = mean_output
        self._every = max(1, round(1.0 / sample_time_s))
        self._standing = np.full((2, len(YAW_CHANNEL)), np.nan)

    def of(self, k: Ints, estimates: EstimateBlock) -> ModesBlock:
        """Return modes and yaw channel of n estimates; ``k`` (n,) are their indices on the grid."""
        block = modes(estimates, self._orders, self._sample_time_s, mean_output=self._mean_output)
        warming_up = estimates.status == Status.WARMING_UP
        due = np.flatnonzero((k % self._every == 0) | warming_up)
        rows = np.concatenate([self._standing[None], self._yaw_rows(estimates, due)])
        newest = np.searchsorted(due, np.arange(len(k)), side="right")
        self._standing = rows[newest[-1]]
        return replace(block, yaw=rows[newest, 0], yaw_std=rows[newest, 1])

    def _yaw_rows(self, estimates: EstimateBlock, due: Ints) -> Floats:
        """Return value and sigma (m, 2, 9) for the rows ``due`` (m,); NaN where eq. 23 fails."""
        rows = np.full((len(due), 2, len(YAW_CHANNEL)), np.nan)
        worth = estimates.status[due] != Status.WARMING_UP
        if estimates.covariance is not None and worth.any():
            rows[worth], _ = with_sigma(
                estimates.theta[due[worth]], estimates.covariance[due[worth]], self._orders,
                self._sample_time_s, mean_output=self._mean_output,
            )  # fmt: skip
        return rows
