"""The response of the identified model to a step of the rudder."""

import numpy as np

from yawid.blocks import Floats
from yawid.config.estimator import ArmaxOrders
from yawid.estimation.all_pole import all_pole


def step_response(theta: Floats, orders: ArmaxOrders, steps: int) -> Floats:
    """Return the response (steps,) of theta (p,) to a unit step of the first input at row 0."""
    b = np.concatenate([np.zeros(orders.nk[0]), theta[orders.na : orders.na + orders.nb[0]]])
    drive = np.cumsum(b)[np.minimum(np.arange(steps), len(b) - 1)]
    return all_pole(theta[: orders.na], drive)
