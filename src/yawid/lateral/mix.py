"""The rudder mix: the part of the aileron that, given to the rudder, rolls with the least sideslip.

Not only the aileron's own yaw N_delta_a makes sideslip in a roll: rolling about a body that is
nose-up turns the angle of attack into sideslip (alpha p), and so do N_p p and gravity. On most
aircraft of JSBSim -N_delta_a / N_delta_r leaves nine tenths of it, and on one makes it larger.
"""

from typing import Final

import numpy as np

from yawid.blocks import Floats
from yawid.lateral.model import AILERON, BETA, ROLL, RUDDER, airframe

ROLLS_S: Final = (0.5, 1.0, 2.0)
"""Rolls: the aileron is held for so long to one side, and then to the other."""
STEP_S: Final = 0.05


def rudder_mixes(theta: Floats, airspeed_m_s: float) -> Floats:
    """Return the mixes (v, 3), rudder per aileron, for each of ROLLS_S and v variants of theta.

    With the sideslip beta_a of the aileron and beta_r of the rudder moved as the aileron is, the
    mix m gives the least integral of (beta_a + m beta_r)^2. NaN where a derivative is not known.
    """
    from scipy.linalg import expm  # it takes long to load, and few runs need it

    A, B = (each[:, :4, :] for each in airframe(theta, airspeed_m_s))
    found = np.full((len(theta), len(ROLLS_S)), np.nan)
    whole = np.zeros((len(theta), 6, 6))
    whole[:, :4, :4], whole[:, :4, 4:] = A[:, :, : ROLL + 1], B[:, :, (AILERON, RUDDER)]
    known = np.isfinite(whole).all(axis=(1, 2))
    if not known.any():
        return found
    step = expm(whole[known] * STEP_S)
    for column, length_s in enumerate(ROLLS_S):
        samples = round(length_s / STEP_S)
        x = np.zeros((len(step), 4, 2))
        sums = np.zeros((2, len(step)))
        for k in range(2 * samples):
            x = step[:, :4, :4] @ x + (1.0 if k < samples else -1.0) * step[:, :4, 4:]
            by_aileron, by_rudder = x[:, BETA, 0], x[:, BETA, 1]
            with np.errstate(over="ignore", invalid="ignore"):  # an airframe that diverges fast
                sums += by_aileron * by_rudder, by_rudder**2
        with np.errstate(invalid="ignore"):
            found[known, column] = -sums[0] / sums[1]
    return found
