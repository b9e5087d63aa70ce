"""The flight test card, which says what to fly next with this aircraft; a type for each object.

What the log does not give is None: the card leaves a blank for it, to be filled in by hand.
"""

from yawid.answers.part import Number, Part, Positive
from yawid.answers.run_summary import DutchRoll


class ParameterToSet(Part, frozen=True, kw_only=True):
    """A parameter to set for the flight; ``now`` holds its values in the log by full names."""

    name: str
    to: Number
    now: dict[str, Number]
    why: str


class ModeToFly(Part, frozen=True, kw_only=True):
    """A flight mode, the loop whose answer it gives, and the log's manoeuvres that ``answered``."""

    mode: str
    loop: str
    answered: list[int]


class Expected(Part, frozen=True, kw_only=True):
    """The sigmas to expect after ``more`` manoeuvres like those of the log."""

    more: int
    wn_std: Number
    zeta_std: Number | None = None


class SurfaceMove(Part, frozen=True, kw_only=True):
    """How far to move rudder or aileron: in percent of half its travel, as pulses, as an angle."""

    percent: Number
    low_us: Number | None = None
    high_us: Number | None = None
    deg: Number | None = None


class ConditionsToFly(Part, frozen=True, kw_only=True):
    """Airspeeds, altitudes and modes: those that were flown, and those to fly.

    ``airspeed_least_m_s`` and ``airspeed_most_m_s`` are the limits in the parameters;
    ``airspeeds_m_s`` are the airspeeds to fly.
    """

    airspeed_source: str | None = None
    airspeed_low_m_s: Number | None = None
    airspeed_m_s: Number | None = None
    airspeed_high_m_s: Number | None = None
    airspeed_least_m_s: Number | None = None
    airspeed_most_m_s: Number | None = None
    airspeeds_m_s: list[Number]
    altitude_low_m: Number | None = None
    altitude_high_m: Number | None = None
    modes: list[ModeToFly]


class ManoeuvreToFly(Part, frozen=True, kw_only=True):
    """The manoeuvre to fly, with its times in s.

    A doublet is ``side_s`` to one side and ``side_s`` to the other; ``unit_s`` is the unit of a
    3-2-1-1. ``doublets`` is the number of doublets in a manoeuvre; after each one the rudder is
    neutral for ``pause_s``, and ``rest_s`` ends the manoeuvre.
    """

    wn_rad_s: Positive
    wn_guessed: bool
    period_s: Positive
    side_s: Positive
    unit_s: Positive
    doublets: int
    pause_s: Number
    manoeuvres: int
    rest_s: Number
    manoeuvre_s: Number
    total_s: Number
    amplitude: list[SurfaceMove]


class AileronDoublet(Part, frozen=True, kw_only=True):
    """The doublet of the aileron after a manoeuvre's last rudder doublet, for the bare airframe.

    It begins ``after_s`` after that one and has ``side_s`` to each side. Attitude and servo outputs
    are needed at ``ask_hz``. ``expected`` has the sigmas of the bare airframe after one.
    """

    after_s: Number
    side_s: Positive
    amplitude: SurfaceMove
    ask_hz: Positive
    expected: Expected


class FlightTestCard(Part, frozen=True, kw_only=True):
    """The card: message rates, parameters, airspeeds, modes, the manoeuvre, and expected sigmas.

    ``answer`` is the log's own answer, ``answered`` the numbers of its manoeuvres; ``aileron`` is
    there where it would make the bare airframe known. ``lacks`` says what the log cannot answer
    yet, and ``live`` is the command for a live session.
    """

    vehicle: str
    autopilot: int | None = None
    ask_hz: Positive
    yaw_hz: Number | None = None
    rudder_hz: Number | None = None
    rates_suffice: bool
    rates: list[ParameterToSet]
    parameters: list[ParameterToSet]
    conditions: ConditionsToFly
    manoeuvre: ManoeuvreToFly
    aileron: AileronDoublet | None = None
    answer: DutchRoll | None = None
    answered: list[int]
    expected: list[Expected]
    lacks: list[str]
    live: str | None = None
