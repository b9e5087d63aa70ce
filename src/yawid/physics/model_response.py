"""The response of the identified model to a step of the rudder."""

import math

import numpy as np

from yawid.blocks import Floats
from yawid.config.estimator import ArmaxOrders
from yawid.estimation.all_pole import all_pole


def step_response(theta: Floats, orders: ArmaxOrders, steps: int) -> Floats:
    """Return the response (steps,) of theta (p,) to a unit step of the first input at row 0."""
    b = np.concatenate([np.zeros(orders.nk[0]), theta[orders.na : orders.na + orders.nb[0]]])
    drive = np.cumsum(b)[np.minimum(np.arange(steps), len(b) - 1)]
    return all_pole(theta[: orders.na], drive)


def early_response(
    theta: Floats, orders: ArmaxOrders, sample_time_s: float, wn_rad_s: float
) -> float:
    """Return the mean yaw rate of theta (p,) over half a period after a unit step; NaN without wn.

    Its sign is the sign of the rudder's effect. That of the DC gain is not reliable: it depends on
    the spiral mode, which a short record does not show.
    """
    if not math.isfinite(wn_rad_s):
        return math.nan
    steps = max(orders.nk[0] + 1, round(math.pi / wn_rad_s / sample_time_s))
    return float(step_response(theta, orders, steps + 1)[1:].mean())
