"""What to fly next for this aircraft: the test card, one type for each object.

What the log does not know is None: the card leaves a blank for it, to be filled in by hand.
"""

from yawid.answers.run_summary import DutchRoll, Number, Part, Positive


class ParameterToSet(Part, frozen=True, kw_only=True):
    """A parameter to set for the flight; ``now`` is its value in the log, by its full name."""

    name: str
    to: Number
    now: dict[str, Number]
    why: str


class ModeToFly(Part, frozen=True, kw_only=True):
    """A flight mode, and whose answer it gives."""

    mode: str
    loop: str
    answered: list[int]


class Expected(Part, frozen=True, kw_only=True):
    """The sigmas to expect after so many more manoeuvres like those of the log."""

    more: int
    wn_std: Number
    zeta_std: Number | None = None


class RudderMove(Part, frozen=True, kw_only=True):
    """How far to move the rudder: of half its travel, as pulses to either side, as an angle."""

    percent: Number
    low_us: Number | None = None
    high_us: Number | None = None
    deg: Number | None = None


class ConditionsToFly(Part, frozen=True, kw_only=True):
    """At which airspeeds, how high, in which modes: what was flown, and what to fly."""

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
    """A doublet is ``side_s`` one way and ``side_s`` the other; a 3-2-1-1 counts in ``unit_s``.

    A manoeuvre is ``doublets`` with ``pause_s`` of neutral rudder after each; ``rest_s`` ends it.
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
    amplitude: list[RudderMove]


class FlightTestCard(Part, frozen=True, kw_only=True):
    """What to fly next: message rates, parameters, airspeeds, modes, manoeuvre, what it will give.

    ``answer`` is what the log says already, ``answered`` by which manoeuvres.
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
    answer: DutchRoll | None = None
    answered: list[int]
    expected: list[Expected]
    lacks: list[str]
    live: str | None = None
