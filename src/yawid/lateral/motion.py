"""What the fit of the bare airframe is given: one stretch of lateral motion, and its commands.

Measurements are on the grid of the attitude messages. Commands have a grid of their own, which is
finer, so that the fit can delay them and send them through the servo's lag exactly.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from yawid.blocks import Floats

Flags = NDArray[np.bool_]
COMMAND_STEP_S = 0.005
"""Step of the commands' grid in s."""
LEAD_S = 0.5
"""Commands needed before the first measurement in s: three servo lags and the delay."""
SURELY_REVERSED = 5.0
"""The sigmas by which roll angle and roll rate go against each other. White noise has 5 never, a
roll angle that is reversed some 20 and more in a manoeuvre."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Motion:
    """One manoeuvre in SI units; times are in s since the first measurement.

    ``p``, ``r``, ``roll``, ``pitch`` and ``q`` (n,) are on the grid k ``sample_time_s``, in rad/s
    and rad, NaN where a sample is missing. ``rudder`` and ``aileron`` (m,) are the commands at
    ``commands_start_s`` + k COMMAND_STEP_S, in the unit of their channel, linear between the
    stamps of the messages and never NaN; they begin LEAD_S before the first measurement where the
    log has them. ``airspeed_m_s`` is the mean true airspeed, ``climb`` the mean angle of climb in
    rad. With ``commands_exact`` False the commands are known on the grid of the measurements only.
    ``aileron_known`` is False where no aileron was found; ``aileron`` is 0 then. The store that
    makes it says in words what is missing.
    """

    sample_time_s: float
    p: Floats
    r: Floats
    roll: Floats
    pitch: Floats
    q: Floats
    commands_start_s: float
    rudder: Floats
    aileron: Floats
    airspeed_m_s: float
    climb: float = 0.0
    commands_exact: bool = True
    aileron_known: bool = True

    def command_times_s(self) -> Floats:
        """Return the times (m,) of the commands in s."""
        times_s = self.commands_start_s + COMMAND_STEP_S * np.arange(len(self.rudder))
        return np.asarray(times_s, np.float64)

    def contradiction(self) -> str | None:
        """Return in words why no airframe moves like this, None where one may."""
        named = {"roll rate": self.p, "yaw rate": self.r, "roll angle": self.roll}
        for name, x in named.items():
            known = x[np.isfinite(x)]
            if not len(known) or float(np.ptp(known)) < 1e-9:
                return f"the {name} does not change during it"
        turned, rate = np.diff(self.roll), self.p[1:] + self.p[:-1]
        both = np.isfinite(turned) & np.isfinite(rate)
        turned, rate = turned[both] - turned[both].mean(), rate[both] - rate[both].mean()
        power = float(turned @ turned) * float(rate @ rate)
        together = float(turned @ rate) / math.sqrt(power) if power > 0.0 else 0.0
        if together * math.sqrt(len(rate)) < -SURELY_REVERSED:
            return "the roll angle falls where the roll rate is positive: one of them is reversed"
        return None
