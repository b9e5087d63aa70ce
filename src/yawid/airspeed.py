"""What an airspeed may be: any room reads it by the same bounds."""

from typing import Final

import numpy as np

from yawid.blocks import Floats

LEAST_M_S: Final = 1.0
"""Nothing with a rudder flies slower; autopilots without a sensor send 0 for what they miss."""
MOST_M_S: Final = 1000.0
"""Three times the speed of sound: what is faster is a damaged number."""


def known(airspeed: Floats) -> Floats:
    """Return airspeeds (n,) in m/s, NaN where the number is none: 0, negative, absurd."""
    return np.where((airspeed >= LEAST_M_S) & (airspeed <= MOST_M_S), airspeed, np.nan)
