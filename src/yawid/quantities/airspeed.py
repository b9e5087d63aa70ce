"""The kinds of airspeed, and the conversions between them.

wn is proportional to the equivalent airspeed, and kappa is their ratio. A calibrated or an
indicated airspeed differs from the equivalent one by less than 1 % below 100 m/s and 3000 m, and
counts as equivalent there. A true airspeed differs by the square root of the air's density ratio,
18 % at 4000 m, and is always converted.
"""

from enum import IntEnum
from typing import Final

import numpy as np

from yawid.blocks import Bools, Floats

LEAST_M_S: Final = 0.1
"""The least airspeed that counts as known. Autopilots without a sensor send 0. A blocked pitot tube
gives some tenths of m/s, which the plausibility check finds."""
MOST_M_S: Final = 1000.0
"""The greatest airspeed that counts as known, three times the speed of sound."""
GROUND_SPEED: Final = "ground speed"
"""The source of an airspeed in a log that has only the ground speed."""
GRAVITY: Final = 9.80665
"""The acceleration of gravity in m/s^2."""


class Kind(IntEnum):
    """The kind of airspeed that a source gives; results have a ``TRUE`` one converted."""

    EQUIVALENT = 1
    CALIBRATED = 2
    INDICATED = 3
    TRUE = 4


def name_of(kind: float) -> str | None:
    """Return the name of a kind in results, None where the kind is unknown (NaN)."""
    return None if not np.isfinite(kind) else Kind(int(kind)).name.lower()


def source_of(by_ground: Bools) -> str:
    """Return the source of most of the airspeeds (n,); ``by_ground`` (n,) marks ground speeds."""
    return GROUND_SPEED if 2 * np.count_nonzero(by_ground) > len(by_ground) else "airspeed"


def known(airspeed: Floats) -> Floats:
    """Return airspeeds (n,) in m/s, NaN where the number is 0, negative or absurd."""
    return np.where((airspeed >= LEAST_M_S) & (airspeed <= MOST_M_S), airspeed, np.nan)


def over_ground(speed: Floats) -> Floats:
    """Return ground speeds (n,) in m/s, NaN where the number is negative or absurd."""
    return np.where((speed >= 0.0) & (speed <= MOST_M_S), speed, np.nan)


SEA_LEVEL_DENSITY: Final = 1.225
_SEA_LEVEL_K, _LAPSE_K_M, _TROPOPAUSE_M = 288.15, 0.0065, 11_000.0
_DENSITY_EXPONENT, _PRESSURE_EXPONENT, _STRATOSPHERE_M = 4.2559, 5.2559, 6341.6
_SOUND_M_S = 340.294
_LOWEST_M, _HIGHEST_M = -500.0, 20_000.0
_LEAST_RHO, _MOST_RHO = 0.05, 1.6
"""The range of the air's density in kg/m^3, from Siberia's ground in winter up to 20 km."""


def density_ratio(altitude_m: Floats, rho: Floats | None = None) -> Floats:
    """Return the air's density over that at sea level (n,), NaN where it is unknown.

    It is the measured ``rho`` (n,) in kg/m^3 where that is possible, else that of the standard
    atmosphere (ICAO) at the altitude (n,) above the sea in m.
    """
    ratio = _standard(altitude_m, _DENSITY_EXPONENT)
    if rho is not None:
        ratio = np.where((rho >= _LEAST_RHO) & (rho <= _MOST_RHO), rho / SEA_LEVEL_DENSITY, ratio)
    return ratio


def _standard(altitude_m: Floats, exponent: float) -> Floats:
    """Return the standard atmosphere's temperature ratio (n,) to a power.

    Above the tropopause the result falls exponentially instead.
    """
    is_sound = (altitude_m >= _LOWEST_M) & (altitude_m <= _HIGHEST_M)
    height = np.where(is_sound, altitude_m, np.nan)
    below = np.minimum(height, _TROPOPAUSE_M)
    ratio = (1.0 - _LAPSE_K_M * below / _SEA_LEVEL_K) ** exponent
    return np.asarray(ratio * np.exp(-np.maximum(height - _TROPOPAUSE_M, 0.0) / _STRATOSPHERE_M))


def equivalent_of_calibrated(calibrated_m_s: Floats, altitude_m: Floats) -> Floats:
    """Return the equivalent airspeed (n,) of a calibrated one, by the pressure at altitudes (n,).

    Both are measures of the dynamic pressure. An airspeed indicator is calibrated with the air's
    compression at sea level, which is less than the compression at the same reading higher up.
    """
    delta = _standard(altitude_m, _PRESSURE_EXPONENT)
    impact = (1.0 + 0.2 * (calibrated_m_s / _SOUND_M_S) ** 2) ** 3.5 - 1.0
    square = 5.0 * delta * ((impact / delta + 1.0) ** (2.0 / 7.0) - 1.0)
    return np.asarray(_SOUND_M_S * np.sqrt(square))


def true_of_equivalent(equivalent_m_s: Floats, altitude_m: Floats) -> Floats:
    """Return the true airspeed (n,) of an equivalent one, at sea level where no altitude is known.

    That is what samples have, whatever the kind of the source's airspeed.
    """
    ratio = density_ratio(altitude_m)
    return np.asarray(equivalent_m_s / np.sqrt(np.where(np.isfinite(ratio), ratio, 1.0)))


def equivalent_of_true(true_m_s: Floats, ratio: Floats) -> Floats:
    """Return the equivalent airspeed (n,) of a true one by density ratios (n,)."""
    return np.asarray(true_m_s * np.sqrt(ratio))
