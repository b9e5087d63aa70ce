"""What every engine can say of its own estimate."""

from __future__ import annotations

import numpy as np

from yawid.blocks import Floats
from yawid.config.estimator import EstimatorConfig
from yawid.estimation.polynomials import c_of, spr_margin


class Readings:
    """Judgements that follow from theta and its standard deviations alone."""

    config: EstimatorConfig

    @property
    def theta(self) -> Floats:
        """Parameters (n,) in the user's units."""
        raise NotImplementedError

    @property
    def theta_std(self) -> Floats:
        """Standard deviation (n,) of theta."""
        raise NotImplementedError

    @property
    def spr_margin(self) -> float:
        """Min Re(1/C) - 1/2 at the estimate: ELS converges surely only where it is > 0."""
        return spr_margin(c_of(self.theta, self.config.orders))

    @property
    def sigma_optimistic(self) -> bool:
        """Whether theta_std is too small: ELS with a C(q) that is not 1."""
        if self.config.method != "els" or self.config.orders.nc == 0:
            return False
        c, std = (c_of(x, self.config.orders) for x in (self.theta, self.theta_std))
        return bool(np.any(np.abs(c) > 3.0 * std))
