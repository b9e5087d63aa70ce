"""The answer of an ordinary flight, in which the rudder was not moved on purpose.

It is of the aircraft without its autopilot, and of its modes and its roll channel only: such a
flight does not show the rudder's effect.
"""

import math
from typing import Annotated, Final

import numpy as np

from yawid.answers.model_parts import DERIVATIVES, DutchRoll, TimeConstant, Value
from yawid.answers.part import Count, Number, Part, named, says
from yawid.answers.reasons import Verdict
from yawid.quantities.airspeed import density_ratio

ORDINARY: Final = "ordinary"
"""The method of a verdict that is an ordinary flight's."""
GATES: Final = (
    "too_short", "rudder_moves", "only_feedback", "aileron_reversed", "no_mode", "rate_too_low",
    "too_damped", "line", "limit_cycle", "too_quiet", "two_answers",
    "band_differs", "uncertain", "no_roll_law", "fit_failed",
)  # fmt: skip
"""The ids of the reasons in its own verdict."""


class RollLaw(Part, frozen=True, kw_only=True):
    """The roll hold found, and the ``r2`` of it.

    aileron = -k_roll roll - k_p p - k_integral (integral of roll) + what is asked for
    """

    k_roll: Annotated[Number, says("aileron per roll, per rad", "unit of aileron per rad")]
    k_p: Annotated[Number, says("aileron per roll rate, per rad/s", "unit of aileron per rad/s")]
    k_integral: Annotated[
        Number, says("aileron per integral of the roll, per rad s", "unit of aileron per rad s")
    ]
    r2: Annotated[Number, says("part of the aileron's changes that it explains", "1")]


OF_SIGNALS: Final = named(p="of the roll rate", r="of the yaw rate", roll="of the roll")
"""The signals that have a spectrum."""


class OrdinarySpectrum(Part, frozen=True, kw_only=True):
    """Spectral densities of p, r and roll, measured and of the fit, at frequencies in rad/s.

    They are in (rad/s)^2 or rad^2 per Hz, on both sides; ``count`` is how many independent
    frequencies each mean has.
    """

    w_rad_s: Annotated[list[Number], says("frequencies")]
    count: Annotated[list[Number], says("independent frequencies in each mean")]
    measured: Annotated[
        dict[str, list[Number]],
        says(
            "of the log, (rad/s)^2 or rad^2 per Hz, on both sides",
            **OF_SIGNALS,
        ),
    ]
    modelled: Annotated[
        dict[str, list[Number]],
        says(
            "of the model, with the inputs as they were",
            **OF_SIGNALS,
        ),
    ]


class Agreement(Part, frozen=True, kw_only=True):
    """How far the manoeuvres' answer is away: of wn and zeta, in sigmas of the difference.

    ``against`` is the manoeuvres' ``bare``, or their ``flight`` with which ``dutch_roll`` or
    ``flown`` is compared.
    """

    against: Annotated[str, says("what it was compared with", enum=["bare", "flight"])]
    wn_sigmas: Annotated[
        Number, says("difference of wn, brought to one airspeed, in sigmas of it", "1")
    ]
    zeta_sigmas: Annotated[Number, says("difference of zeta, in sigmas of it", "1")]


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

    dutch_roll: Annotated[
        DutchRoll | None, says("of the bare airframe; absent where a gate stops it")
    ] = None
    poles: Annotated[
        list[list[Number]] | None,
        says("real and imaginary part of each, in rad/s; the pair is the Dutch roll"),
    ] = None
    roll_mode: Annotated[TimeConstant | None, says("how fast a roll rate decays")] = None
    derivatives: Annotated[
        dict[str, Value] | None,
        says(
            "dimensional, per rad, rad/s or unit of the input, with Ixz folded in",
            **DERIVATIVES,
        ),
    ] = None
    flown: Annotated[
        DutchRoll | None, says("the same mode under the roll law found, where that is known")
    ] = None
    flown_verdict: Annotated[
        Verdict | None, says("whether it is known under the roll law; if not, why")
    ] = None
    law: Annotated[
        RollLaw | None,
        says(
            "the roll hold found: aileron = -k_roll roll - k_p p - k_integral "
            "(integral of roll) + what is asked for"
        ),
    ] = None
    airspeed_m_s: Annotated[Number | None, says("mean true airspeed of what was used", "m/s")] = (
        None
    )
    airspeed_source: Annotated[
        str | None, says("where that airspeed is from", enum=["airspeed", "ground speed"])
    ] = None
    altitude_m: Annotated[Number | None, says("mean altitude flown at this airspeed", "m")] = None
    seconds: Annotated[Number, says("length of the ordinary flight used, at one airspeed", "s")] = (
        0.0
    )
    seen_s: Annotated[Number, says("length of all that was looked at", "s")] = 0.0
    turns: Annotated[Count, says("turns in what was used")] = 0
    windows: Annotated[Count, says("stretches of up to 120 s in what was used")] = 0
    share: Annotated[
        Number | None, says("part of the roll rate's power near the mode that turns make", "1")
    ] = None
    band_rad_s: Annotated[list[Number] | None, says("lowest and highest frequency used")] = None
    spectrum: Annotated[
        OrdinarySpectrum | None,
        says("densities of p, r and roll, as measured and as the model has them"),
    ] = None
    agrees: Annotated[
        Agreement | None,
        says(
            "how far the manoeuvres' answer is away; absent where none is known near this airspeed"
        ),
    ] = None
    verdict: Annotated[Verdict, says("whether it is known; if not, why, and what to do")]

    def __bool__(self) -> bool:
        """Return whether it is usable."""
        return self.verdict.usable

    @property
    def equivalent_airspeed_m_s(self) -> float | None:
        """The equivalent airspeed, None where the altitude is unknown."""
        if self.airspeed_m_s is None or self.altitude_m is None:
            return None
        return self.airspeed_m_s * math.sqrt(float(density_ratio(np.array([self.altitude_m]))[0]))
