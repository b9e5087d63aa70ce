"""The bare airframe as the fit finds it: modes and derivatives with sigma, and the verdict."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import msgspec
import numpy as np

from yawid.answers.run_summary import Bare, Value
from yawid.blocks import Floats
from yawid.lateral.model import modes, theta_of

_STEPS, _SLOPE = 20, 1e-5


@dataclass(frozen=True, slots=True)
class Known:
    """A value and its sigma; NaN is what is not known."""

    value: float = math.nan
    std: float = math.nan


@dataclass(frozen=True, slots=True, kw_only=True)
class Airframe:
    """The bare airframe at one airspeed. Inputs are in the unit of their channel.

    ``wn_rad_s`` and ``zeta`` are the Dutch roll's, ``roll_s`` and ``spiral_s`` time constants in s
    (negative: it diverges). ``derivatives`` are those of eq. 20-22 in the field's symbols, by
    DESIGN's names: dimensional, in 1/s (of rates, and Y_beta and Y_delta_r per airspeed) or 1/s^2,
    with Ixz folded in. ``gust_std_rad`` is the sideslip of the gusts and ``rho1`` the largest
    autocorrelation of the innovations over one sample, or over 40 ms where that is more. ``failed``
    is what was found for each gate of ``gates.GATES`` that stops it, by name: empty where the
    airframe is known.
    """

    wn_rad_s: Known
    zeta: Known
    roll_s: Known
    spiral_s: Known
    derivatives: dict[str, Known]
    alpha_rad: Known
    servo_lag_s: Known
    correlations: Floats
    """Of the derivatives, ``alpha_rad`` and ``servo_lag_s`` (14, 14)."""
    from_prior: tuple[str, ...]
    """Those of them whose sigma is nearly that of what is known beforehand."""
    delay_s: Known
    rudder_mix: Known
    """The rudder per aileron that rolls with the least sideslip."""
    gust_std_rad: float
    rho1: float
    airspeed_m_s: float
    as_flown: tuple[Known, Known] | None = None
    """Its wn and zeta closed with the roll law of the aileron, None where none is found."""
    given_lag_s: Known = Known()
    free_lag_s: Known = Known()
    """The servo lag that was given, and what a fit without it finds; NaN where none was given."""
    failed: Mapping[str, float] = field(default_factory=dict)


def with_modes(found: Bare, correlations: Floats) -> Bare:
    """Return an answer whose derivatives changed by the least, in sigma, that gives its modes.

    Means of modes and means of derivatives are of two aircraft, as modes are no linear function.

    ``correlations`` (n + 1, n + 1) are of the derivatives, the angle of attack and the servo lag.
    """
    roll, speed_m_s, alpha = found.dutch_roll, found.airspeed_m_s, found.alpha_rad
    if roll is None or speed_m_s is None or alpha is None or found.derivatives is None:
        return found
    known = {**found.derivatives, "alpha_rad": alpha}
    std = np.array([each.std or 0.0 for each in known.values()])
    covariance = correlations[: len(std), : len(std)] * np.outer(std, std)
    value, step = np.array([each.value for each in known.values()], float), _SLOPE * std
    poles = [-1.0 / each.time_constant_s if each is not None else np.nan
             for each in (found.roll_mode, found.spiral)]  # fmt: skip
    wanted = np.array([roll.wn_rad_s, roll.zeta, *poles])
    given = np.isfinite(wanted)
    for _ in range(_STEPS):
        theta = theta_of([*known], np.vstack([value, value + np.diag(step)]))
        now = modes(theta, speed_m_s)[:, given]
        if not np.isfinite(now).all():  # a mode is lost on the way
            return found
        slopes = (now[1:] - now[0]).T / step
        gain = covariance @ slopes.T @ np.linalg.pinv(slopes @ covariance @ slopes.T)
        value = value + gain @ (wanted[given] - now[0])
    if not np.allclose(now[0], wanted[given], rtol=1e-9, atol=1e-12):
        return found
    both = zip(known.items(), value.tolist(), strict=True)
    numbers = {name: Value(new, each.std) for (name, each), new in both}
    return msgspec.structs.replace(found, alpha_rad=numbers.pop("alpha_rad"), derivatives=numbers)
