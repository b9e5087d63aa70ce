"""The flight test card, which says what to fly next with this aircraft; a type for each object.

What the log does not give is None: the card leaves a blank for it, to be filled in by hand.
"""

from typing import Annotated

from yawid.answers.part import Number, Part, Positive, says
from yawid.answers.run_summary import DutchRoll


class ParameterToSet(Part, frozen=True, kw_only=True):
    """A parameter to set for the flight; ``now`` holds its values in the log by full names."""

    name: Annotated[str, says("of the parameter")]
    to: Annotated[Number, says("value to set", "of the parameter")]
    now: Annotated[
        dict[str, Number],
        says(
            "values in the log, by their full names",
            "of the parameter",
            propertyNames={"pattern": r"^[A-Z0-9_]+$"},
        ),
    ]
    why: Annotated[str, says("what it is for")]


class ModeToFly(Part, frozen=True, kw_only=True):
    """A flight mode, the loop whose answer it gives, and the log's manoeuvres that ``answered``."""

    mode: Annotated[str, says("by its name")]
    loop: Annotated[str, says(enum=["airframe", "with_roll_loop", "unknown"])]
    answered: Annotated[list[int], says("numbers n of the manoeuvres that answer it already")]


class Expected(Part, frozen=True, kw_only=True):
    """The sigmas to expect after ``more`` manoeuvres like those of the log."""

    more: Annotated[int, says("so many more")]
    wn_std: Annotated[Number, says("total sigma of wn then", "rad/s")]
    zeta_std: Annotated[Number | None, says("total sigma of zeta then", "1")] = None


class SurfaceMove(Part, frozen=True, kw_only=True):
    """How far to move rudder or aileron: in percent of half its travel, as pulses, as an angle."""

    percent: Annotated[Number, says("of half its travel", "%")]
    low_us: Annotated[Number | None, says("pulse on one side", "us")] = None
    high_us: Annotated[Number | None, says("pulse on the other side", "us")] = None
    deg: Annotated[Number | None, says("deflection, where --rudder-max-deg is given", "deg")] = None


class ConditionsToFly(Part, frozen=True, kw_only=True):
    """Airspeeds, altitudes and modes: those that were flown, and those to fly.

    ``airspeed_least_m_s`` and ``airspeed_most_m_s`` are the limits in the parameters;
    ``airspeeds_m_s`` are the airspeeds to fly.
    """

    airspeed_source: Annotated[
        str | None, says("what this log's airspeeds are", enum=["airspeed", "ground speed"])
    ] = None
    airspeed_low_m_s: Annotated[Number | None, says("10th percentile flown", "m/s")] = None
    airspeed_m_s: Annotated[Number | None, says("median flown", "m/s")] = None
    airspeed_high_m_s: Annotated[Number | None, says("90th percentile flown", "m/s")] = None
    airspeed_least_m_s: Annotated[Number | None, says("limit in the parameters", "m/s")] = None
    airspeed_most_m_s: Annotated[Number | None, says("limit in the parameters", "m/s")] = None
    airspeeds_m_s: Annotated[
        list[Number], says("to fly, one after the other; empty where the log knows none")
    ]
    altitude_low_m: Annotated[Number | None, says("10th percentile flown, above the sea", "m")] = (
        None
    )
    altitude_high_m: Annotated[Number | None, says("90th percentile flown, above the sea", "m")] = (
        None
    )
    modes: Annotated[list[ModeToFly], says("flight modes to fly it in")]


class ManoeuvreToFly(Part, frozen=True, kw_only=True):
    """The manoeuvre to fly, with its times in s.

    A doublet is ``side_s`` to one side and ``side_s`` to the other; ``unit_s`` is the unit of a
    3-2-1-1. ``doublets`` is the number of doublets in a manoeuvre; after each one the rudder is
    neutral for ``pause_s``, and ``rest_s`` ends the manoeuvre.
    """

    wn_rad_s: Annotated[
        Positive, says("natural frequency from which all times are computed", "rad/s")
    ]
    wn_guessed: Annotated[
        bool, says("whether that is a guess from the airspeed, as there is no usable answer")
    ]
    period_s: Annotated[Positive, says("of the damped swing", "s")]
    side_s: Annotated[Positive, says("of a doublet: the time on each side", "s")]
    unit_s: Annotated[Positive, says("of a 3-2-1-1", "s")]
    doublets: Annotated[int, says("of a manoeuvre")]
    pause_s: Annotated[Number, says("of neutral rudder after each of them", "s")]
    manoeuvres: Annotated[int, says("at each airspeed, in one mode")]
    rest_s: Annotated[Number, says("of neutral rudder that ends a manoeuvre", "s")]
    manoeuvre_s: Annotated[Number, says("length of a manoeuvre without that rest", "s")]
    total_s: Annotated[Number, says("of all airspeeds, with the time to settle", "s")]
    amplitude: Annotated[
        list[SurfaceMove], says("how far to move the rudder: to begin with, and at most")
    ]


class AileronDoublet(Part, frozen=True, kw_only=True):
    """The doublet of the aileron after a manoeuvre's last rudder doublet, for the bare airframe.

    It begins ``after_s`` after that one and has ``side_s`` to each side. Attitude and servo outputs
    are needed at ``ask_hz``. ``expected`` has the sigmas of the bare airframe after one.
    """

    after_s: Annotated[Number, says("time between the last rudder doublet and it", "s")]
    side_s: Annotated[Positive, says("of a doublet: the time on each side", "s")]
    amplitude: Annotated[SurfaceMove, says("how far to move the aileron")]
    ask_hz: Annotated[Positive, says("rate of attitude and servo outputs that is needed", "Hz")]
    expected: Annotated[Expected, says("sigmas of the bare airframe after one such manoeuvre")]


class FlightTestCard(Part, frozen=True, kw_only=True):
    """The card: message rates, parameters, airspeeds, modes, the manoeuvre, and expected sigmas.

    ``answer`` is the log's own answer, ``answered`` the numbers of its manoeuvres; ``aileron`` is
    there where it would make the bare airframe known. ``lacks`` says what the log cannot answer
    yet, and ``live`` is the command for a live session.
    """

    vehicle: Annotated[str, says("kind of vehicle and autopilot")]
    autopilot: Annotated[
        int | None,
        says("MAV_AUTOPILOT of its HEARTBEAT; 3 is ArduPilot, 12 is PX4", "MAV_AUTOPILOT"),
    ] = None
    ask_hz: Annotated[Positive, says("message rate to ask for", "Hz")]
    yaw_hz: Annotated[
        Number | None, says("messages of the yaw rate a second in this log", "Hz")
    ] = None
    rudder_hz: Annotated[
        Number | None, says("messages of the rudder a second in this log", "Hz")
    ] = None
    rates_suffice: Annotated[bool, says("whether both are enough for this aircraft")]
    rates: Annotated[
        list[ParameterToSet], says("ArduPilot's stream rates, n the number of the port")
    ]
    parameters: Annotated[
        list[ParameterToSet], says("parameters to set for the flight and to restore after it")
    ]
    conditions: Annotated[ConditionsToFly, says("at which airspeeds, how high, in which modes")]
    manoeuvre: Annotated[ManoeuvreToFly, says("what to do with the rudder, and how often")]
    aileron: Annotated[
        AileronDoublet | None, says("its doublet that would make the bare airframe known")
    ] = None
    answer: Annotated[
        DutchRoll | None, says("what this log answers already, if that is usable")
    ] = None
    answered: Annotated[list[int], says("numbers n of the manoeuvres that answer it already")]
    expected: Annotated[
        list[Expected], says("sigmas to expect after more manoeuvres like this log's")
    ]
    lacks: Annotated[list[str], says("what this log leaves open, in words")]
    live: Annotated[str | None, says("the command that follows the flight, for a shell")] = None
