"""The answer of an ordinary flight, in which the rudder was not moved on purpose.

It is of the aircraft without its autopilot, and of its modes and its roll channel only: such a
flight does not show the rudder's effect.
"""

import math
from typing import Final

import numpy as np

from yawid.answers.model_parts import DutchRoll, TimeConstant, Value
from yawid.answers.part import Count, Number, Part
from yawid.answers.reasons import Verdict
from yawid.quantities.airspeed import density_ratio

ORDINARY: Final = "ordinary"
"""The method of a verdict that is an ordinary flight's."""
GATES: Final = (
    "too_short", "rudder_moves", "only_feedback", "no_mode", "rate_too_low", "too_damped",
    "turns_differ", "line", "limit_cycle", "too_quiet", "two_answers", "band_differs", "uncertain",
    "no_roll_law", "fit_failed",
)  # fmt: skip
"""The ids of the reasons in its own verdict."""


class RollLaw(Part, frozen=True, kw_only=True):
    """The roll hold found, and the ``r2`` of it.

    aileron = -k_roll roll - k_p p - k_integral (integral of roll) + what is asked for
    """

    k_roll: Number
    k_p: Number
    k_integral: Number
    r2: Number


class OrdinarySpectrum(Part, frozen=True, kw_only=True):
    """Spectral densities of p, r and roll, measured and of the fit, at frequencies in rad/s.

    They are in (rad/s)^2 or rad^2 per Hz, on both sides; ``count`` is how many independent
    frequencies each mean has.
    """

    w_rad_s: list[Number]
    count: list[Number]
    measured: dict[str, list[Number]]
    modelled: dict[str, list[Number]]


class Agreement(Part, frozen=True, kw_only=True):
    """How far the manoeuvres' answer is away: of wn and zeta, in sigmas of the difference.

    ``against`` is the manoeuvres' ``bare``, or their ``flight`` with which ``dutch_roll`` or
    ``flown`` is compared.
    """

    against: str
    wn_sigmas: Number
    zeta_sigmas: Number


class OrdinaryAnswer(Part, frozen=True, kw_only=True):
    """What an ordinary flight shows of the bare airframe at one airspeed, and its verdict.

    ``poles`` are [real, imaginary] in rad/s. ``derivatives`` are L_p, L_delta_a, L_beta and N_beta
    of eq. 20-21; those of the aileron have in them the rudder that an autopilot mixes to it.
    ``flown`` is the same mode under the roll law found, a by-product with its own sigma and
    verdict. ``seconds`` are the time used, ``seen_s`` all of it; ``share`` is the part of the
    roll rate's power near the mode that what is asked of the aileron makes. The airspeed is the
    true one, ``altitude_m`` the mean above the sea. A run's summary leaves out the numbers that a
    gate stops.
    """

    dutch_roll: DutchRoll | None = None
    poles: list[list[Number]] | None = None
    roll_mode: TimeConstant | None = None
    derivatives: dict[str, Value] | None = None
    flown: DutchRoll | None = None
    flown_verdict: Verdict | None = None
    law: RollLaw | None = None
    airspeed_m_s: Number | None = None
    airspeed_source: str | None = None
    altitude_m: Number | None = None
    seconds: Number = 0.0
    seen_s: Number = 0.0
    turns: Count = 0
    windows: Count = 0
    share: Number | None = None
    band_rad_s: list[Number] | None = None
    spectrum: OrdinarySpectrum | None = None
    agrees: Agreement | None = None
    verdict: Verdict

    def __bool__(self) -> bool:
        """Return whether it is usable."""
        return self.verdict.usable

    @property
    def equivalent_airspeed_m_s(self) -> float | None:
        """The equivalent airspeed, None where the altitude is unknown."""
        if self.airspeed_m_s is None or self.altitude_m is None:
            return None
        return self.airspeed_m_s * math.sqrt(float(density_ratio(np.array([self.altitude_m]))[0]))
