"""What an airspeed may be, and how one kind becomes another.

wn goes with the equivalent airspeed: kappa is wn over it. A calibrated or an indicated airspeed
differs from it by less than 1 % below 100 m/s and 3000 m, and is taken for it there; a true one
differs by the square root of the air's density, 18 % at 4000 m, and never is.
"""

from enum import IntEnum
from typing import Final

import numpy as np

from yawid.blocks import Bools, Floats

LEAST_M_S: Final = 0.1
"""Nothing with a rudder flies slower; autopilots without a sensor send 0 for what they miss. A
blocked pitot gives some tenths: that it cannot be true is for the plausibility check to say."""
MOST_M_S: Final = 1000.0
"""Three times the speed of sound: what is faster is a damaged number."""
GROUND_SPEED: Final = "ground speed"
"""The source of an airspeed where a log knows nothing better."""
GRAVITY: Final = 9.80665
"""In m/s^2: a bank at an airspeed V turns by g / V times its sine."""


class Kind(IntEnum):
    """What a source gives for the airspeed; of a ``TRUE`` one results have the equivalent."""

    EQUIVALENT = 1
    CALIBRATED = 2
    INDICATED = 3
    TRUE = 4


def name_of(kind: float) -> str | None:
    """Return a kind as results call it, None where it is not known (NaN)."""
    return None if not np.isfinite(kind) else Kind(int(kind)).name.lower()


def source_of(by_ground: Bools) -> str:
    """Return what airspeeds (n,) are that are the ground speed in places: what most of them are."""
    return GROUND_SPEED if 2 * np.count_nonzero(by_ground) > len(by_ground) else "airspeed"


def known(airspeed: Floats) -> Floats:
    """Return airspeeds (n,) in m/s, NaN where the number is none: 0, negative, absurd."""
    return np.where((airspeed >= LEAST_M_S) & (airspeed <= MOST_M_S), airspeed, np.nan)


def over_ground(speed: Floats) -> Floats:
    """Return ground speeds (n,) in m/s, NaN where the number is none; 0 is one."""
    return np.where((speed >= 0.0) & (speed <= MOST_M_S), speed, np.nan)


SEA_LEVEL_DENSITY: Final = 1.225
_SEA_LEVEL_K, _LAPSE_K_M, _TROPOPAUSE_M = 288.15, 0.0065, 11_000.0
_DENSITY_EXPONENT, _PRESSURE_EXPONENT, _STRATOSPHERE_M = 4.2559, 5.2559, 6341.6
_SOUND_M_S = 340.294
_LOWEST_M, _HIGHEST_M = -500.0, 20_000.0
_LEAST_RHO, _MOST_RHO = 0.05, 1.6
"""Of air from the ground in Siberia's winter up to 20 km; anything else is no density."""


def density_ratio(altitude_m: Floats, rho: Floats | None = None) -> Floats:
    """Return the air's density over that at sea level (n,), NaN where it is not known.

    As measured where ``rho`` (n,) in kg/m^3 says it, else of the standard atmosphere (ICAO) at the
    altitude above the sea.
    """
    ratio = _standard(altitude_m, _DENSITY_EXPONENT)
    if rho is not None:
        ratio = np.where((rho >= _LEAST_RHO) & (rho <= _MOST_RHO), rho / SEA_LEVEL_DENSITY, ratio)
    return ratio


def _standard(altitude_m: Floats, exponent: float) -> Floats:
    """Return the standard atmosphere's temperature ratio (n,) to a power, and what is above."""
    is_sound = (altitude_m >= _LOWEST_M) & (altitude_m <= _HIGHEST_M)
    height = np.where(is_sound, altitude_m, np.nan)
    below = np.minimum(height, _TROPOPAUSE_M)
    ratio = (1.0 - _LAPSE_K_M * below / _SEA_LEVEL_K) ** exponent
    return np.asarray(ratio * np.exp(-np.maximum(height - _TROPOPAUSE_M, 0.0) / _STRATOSPHERE_M))


def equivalent_of_calibrated(calibrated_m_s: Floats, altitude_m: Floats) -> Floats:
    """Return the equivalent airspeed (n,) of a calibrated one by the pressure at an altitude (n,).

    Both are the speed that gives the same dynamic pressure; an airspeed indicator is calibrated
    with the compression at sea level, which is less than that at the same reading higher up.
    """
    delta = _standard(altitude_m, _PRESSURE_EXPONENT)
    impact = (1.0 + 0.2 * (calibrated_m_s / _SOUND_M_S) ** 2) ** 3.5 - 1.0
    square = 5.0 * delta * ((impact / delta + 1.0) ** (2.0 / 7.0) - 1.0)
    return np.asarray(_SOUND_M_S * np.sqrt(square))


def equivalent_of_true(true_m_s: Floats, ratio: Floats) -> Floats:
    """Return the equivalent airspeed (n,) of a true one at a density ratio (n,)."""
    return np.asarray(true_m_s * np.sqrt(ratio))
