"""The result of ``yawid damper``, as ``--json`` prints it; a type for each object."""

from yawid.answers.part import Count, Number, Part, Positive
from yawid.answers.reasons import Verdict


class DamperAt(Part, frozen=True, kw_only=True):
    """The closed loop at one airspeed, and the margins of the open loop at their 95 % bound.

    What is not known is None: wn and zeta where the pair has become two real poles, a margin where
    nothing crosses in the frequencies over which the model is known.
    """

    airspeed_m_s: Positive
    wn_rad_s: Number | None = None
    wn_std: Number | None = None
    zeta: Number | None = None
    zeta_std: Number | None = None
    gain_margin_db: Number | None = None
    phase_margin_deg: Number | None = None


class DamperGain(Part, frozen=True, kw_only=True):
    """One value of the parameter, and the loop at each airspeed."""

    value: Number
    at: list[DamperAt]


class Recommended(Part, frozen=True, kw_only=True):
    """The band of gains aimed at, and the one to fly next on the way there."""

    low: Number
    high: Number
    next: Number


class Decay(Part, frozen=True, kw_only=True):
    """The one damped sine that fits the free decays; its sigmas are None with fewer than three."""

    wn_rad_s: Number
    wn_std: Number | None = None
    zeta: Number
    zeta_std: Number | None = None
    decays: Count


class FlownGain(Part, frozen=True, kw_only=True):
    """A gain of one flight: the Dutch roll predicted from the other flight's model, and decays.

    ``decay_predicted`` is the same fit of the predicted response. What is not known is None.
    """

    flight: str
    gain: Number
    airspeed_m_s: Positive
    wn_rad_s: Number | None = None
    wn_std: Number | None = None
    zeta: Number | None = None
    zeta_std: Number | None = None
    decay: Decay | None = None
    decay_predicted: Decay | None = None
    agrees: bool | None = None


class Mix(Part, frozen=True, kw_only=True):
    """The part of the aileron that the rudder needs, and the one flown, in the autopilot's unit.

    ``value`` is None where it is not known: ``text`` says why, or what the value means.
    """

    parameter: str
    flown: Number | None = None
    value: Number | None = None
    std: Number | None = None
    airspeed_m_s: Positive | None = None
    text: str


class DamperReport(Part, frozen=True, kw_only=True):
    """The gains of a yaw damper and what each of them gives; a prediction, to be flown in steps.

    ``parameter`` is the autopilot's own, ``flown`` its value in the log. ``recommended`` is None
    where no gain can be recommended: the verdict says why. ``says`` holds sentences for the pilot.
    """

    log: str
    autopilot: str | None = None
    parameter: str | None = None
    flown: Number | None = None
    loop_rate_hz: Positive | None = None
    gains: list[DamperGain]
    recommended: Recommended | None = None
    mix: Mix | None = None
    says: list[str]
    verdict: Verdict
