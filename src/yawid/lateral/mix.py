"""The rudder mix: the part of the aileron that, given to the rudder, rolls with the least sideslip.

Not only the aileron's own yaw N_delta_a makes sideslip in a roll: rolling about a body that is
nose-up turns the angle of attack into sideslip (alpha p), and so do N_p p and gravity. On most
aircraft of JSBSim -N_delta_a / N_delta_r leaves nine tenths of it, and on one makes it larger.
"""

from typing import Final

import numpy as np

from yawid.blocks import Floats
from yawid.lateral.model import AILERON, BETA, RUDDER, airframe
from yawid.lateral.predictor import exponential

ROLLS_S: Final = (0.5, 1.0, 2.0)
"""Rolls: the aileron is held for so long to one side, and then to the other."""
STEP_S: Final = 0.05


def rudder_mixes(theta: Floats, airspeed_m_s: float) -> Floats:
    """Return the mixes (v, 3), rudder per aileron, for each of ROLLS_S and v variants of theta.

    With the sideslip beta_a of the aileron and beta_r of the rudder moved as the aileron is, the
    mix m gives the least integral of (beta_a + m beta_r)^2. NaN where a derivative is not known.
    """
    A, B = airframe(theta, airspeed_m_s)
    Phi, area, _ = exponential(A[:, :4, :4], STEP_S)
    x, drive = np.zeros((len(theta), 4, 2)), area @ B[:, :4, [AILERON, RUDDER]]
    held = []
    with np.errstate(over="ignore", invalid="ignore"):  # an airframe that diverges fast
        for _ in range(round(2.0 * ROLLS_S[-1] / STEP_S)):
            x = Phi @ x + drive
            held.append(x[:, BETA])
        found = []
        for length in (round(each / STEP_S) for each in ROLLS_S):
            beta = np.array(held[: 2 * length])
            beta[length:] -= 2.0 * np.array(held[:length])  # held to one side, then to the other
            found.append(
                -(beta[..., 0] * beta[..., 1]).sum(axis=0) / (beta[..., 1] ** 2).sum(axis=0)
            )
    return np.stack(found, axis=1)
