"""The result of ``yawid damper``, as ``--json`` prints it; a type for each object."""

from typing import Annotated

from yawid.answers.part import Count, Number, Part, Positive, says
from yawid.answers.reasons import Verdict


class DamperAt(Part, frozen=True, kw_only=True):
    """The closed loop at one airspeed, and the margins of the open loop at their 95 % bound.

    What is not known is None: wn, zeta and the settling time where the pair has become two real
    poles, a margin where nothing crosses in the frequencies over which the model is known.
    """

    airspeed_m_s: Annotated[Positive, says("equivalent airspeed of the prediction", "m/s")]
    wn_rad_s: Annotated[
        Number | None,
        says(
            "natural frequency of the damped Dutch roll; absent where it no longer oscillates",
            "rad/s",
        ),
    ] = None
    wn_std: Number | None = None
    zeta: Annotated[Number | None, says("its damping ratio", "1")] = None
    zeta_std: Number | None = None
    settling_s: Annotated[
        Number | None,
        says(
            "from a step of the pilot's rudder until the damped Dutch roll in the yaw rate "
            "stays within 5 % of its largest; absent where it no longer oscillates",
            "s",
        ),
    ] = None
    settling_std: Number | None = None
    gain_margin_db: Annotated[
        Number | None,
        says("gain margin of the open loop at the 95 % bound of the model; absent where unknown"),
    ] = None
    phase_margin_deg: Annotated[
        Number | None,
        says(
            "phase margin of the open loop at the 95 % bound of the model; "
            "absent where |L| does not cross 1, or unknown",
            "deg",
        ),
    ] = None


class DamperGain(Part, frozen=True, kw_only=True):
    """One value of the parameter, and the loop at each airspeed."""

    value: Annotated[Number, says("the value of the parameter", "as the quantity it belongs to")]
    at: Annotated[list[DamperAt], says("the closed loop and its margins, at each airspeed")]


class Recommended(Part, frozen=True, kw_only=True):
    """The band of gains aimed at, and the one to fly next on the way there."""

    low: Annotated[Number, says("the lowest gain of the band")]
    high: Annotated[Number, says("the highest gain of the band")]
    next: Annotated[Number, says("the gain to fly next")]


class Decay(Part, frozen=True, kw_only=True):
    """The one damped sine that fits the free decays; its sigmas are None with fewer than three."""

    wn_rad_s: Annotated[Number, says("natural frequency of the damped sine", "rad/s")]
    wn_std: Number | None = None
    zeta: Annotated[Number, says("its damping ratio", "1")]
    zeta_std: Number | None = None
    decays: Annotated[Count, says("how many decays were fitted together")]


class FlownGain(Part, frozen=True, kw_only=True):
    """A gain of one flight: the Dutch roll predicted from the other flight's model, and decays.

    ``decay_predicted`` is the same fit of the predicted response. What is not known is None.
    """

    flight: Annotated[str, says("A or B")]
    gain: Annotated[Number, says("the gain flown")]
    airspeed_m_s: Annotated[Positive, says("mean equivalent airspeed of its manoeuvres", "m/s")]
    wn_rad_s: Annotated[
        Number | None,
        says(
            "natural frequency of the damped Dutch roll, predicted from the "
            "other flight; absent where that predicts nothing",
            "rad/s",
        ),
    ] = None
    wn_std: Number | None = None
    zeta: Annotated[Number | None, says("its damping ratio", "1")] = None
    zeta_std: Number | None = None
    decay: Annotated[
        Decay | None, says("damped sine fitted to the free decays in flight; absent without any")
    ] = None
    decay_predicted: Annotated[
        Decay | None, says("the same fit of the response that the other flight's model predicts")
    ] = None
    agrees: Annotated[
        bool | None,
        says("whether both decays agree within the larger of .05, 15 % of zeta and 2 sigma"),
    ] = None


class Mix(Part, frozen=True, kw_only=True):
    """The part of the aileron that the rudder needs, and the one flown, in the autopilot's unit.

    ``value`` is None where it is not known: ``text`` says why, or what the value means.
    """

    parameter: Annotated[str, says("the autopilot's parameter of the mix")]
    flown: Annotated[
        Number | None, says("its value in the log; absent where the log does not say")
    ] = None
    value: Annotated[
        Number | None,
        says(
            "the mix that rolls with the least sideslip, in the parameter's "
            "unit; absent where not known",
            "as the quantity it belongs to",
        ),
    ] = None
    std: Annotated[Number | None, says("its sigma", "as the quantity it belongs to")] = None
    airspeed_m_s: Annotated[
        Positive | None, says("equivalent airspeed of the bare airframe", "m/s")
    ] = None
    text: Annotated[str, says("what it means, or why it is not known and what to do")]


class DamperReport(Part, frozen=True, kw_only=True):
    """The gains of a yaw damper and what each of them gives; a prediction, to be flown in steps.

    ``parameter`` is the autopilot's own, ``flown`` its value in the log. ``recommended`` is None
    where no gain can be recommended: the verdict says why. ``says`` holds sentences for the pilot.
    """

    log: Annotated[
        str, says("absolute path of the log, or the endpoint of a live session without a tlog")
    ]
    autopilot: Annotated[str | None, says("the autopilot whose damper it is")] = None
    parameter: Annotated[str | None, says("the autopilot's parameter of the gain")] = None
    flown: Annotated[Number | None, says("its value in the log")] = None
    loop_rate_hz: Annotated[Positive | None, says("rate of the autopilot's loop", "Hz")] = None
    aircraft: Annotated[
        str | None,
        says(
            "what the gains rest on: the bare airframe, closed with the roll hold "
            "it flew under, or the answer as flown; absent where there are none",
            enum=["airframe", "as_flown"],
        ),
    ] = None
    gains: Annotated[list[DamperGain], says("the gains, ascending, and what each of them gives")]
    recommended: Annotated[
        Recommended | None,
        says(
            "the band of gains aimed at, and the one to fly next; absent where "
            "none can be recommended"
        ),
    ] = None
    mix: Annotated[
        Mix | None,
        says("how much of the aileron the rudder needs; absent where the autopilot is not known"),
    ] = None
    says: Annotated[list[str], says("what it means and what to look for, in sentences")]
    verdict: Annotated[Verdict, says("whether gains can be predicted, and why not")]
