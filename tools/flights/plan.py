"""Flights as data: of one manoeuvre, or legs one after the other; and the sealed aircraft.

A plan of legs is one of the folder plans, a TOML file, or made in Python:

    aircraft = "c172p"
    speed_kt = 95.0
    [[leg]]
    kind = "manoeuvre"
    seconds = 60.0
    shape = "3211"
    [[leg]]
    kind = "turn"
    seconds = 25.0
    bank_deg = 20.0

This flies a 3-2-1-1 and a turn; :class:`Leg` describes all fields of a leg. On the aircraft of
sealed.toml no limit is ever chosen.
"""

from __future__ import annotations

import math
import tomllib
from dataclasses import dataclass, field
from itertools import accumulate, cycle
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import max_len_seq

STEP_S = 0.001  # boot time counts milliseconds: every message falls on a step
SENSED_MS = 20
"""The autopilot reads its sensors at 50 Hz, as ArduPlane's loop does: their noise changes then."""
LEAD_IN_S = 5.0  # the flight starts at trim, while a receiver finds vehicle and parameters
MANOEUVRES = ("3211", "doublets", "prbs", "sweep", "none")
SWEEP_S = 45.0  # length of one sweep
KNOT, FOOT = 0.514444, 0.3048
Floats = NDArray[np.float64]
Place = tuple[str, float, float]
"""Name of an aircraft, altitude in ft and calibrated airspeed in kt."""


class FlightError(RuntimeError):
    """The aircraft cannot be loaded, trimmed or flown as asked."""


@dataclass(frozen=True, slots=True)
class Servo:
    """One servo output: its travel in us as SERVOn_MIN, _TRIM and _MAX, and SERVOn_REVERSED."""

    min_us: int = 1100
    trim_us: int = 1500
    max_us: int = 1900
    reverse: bool = False

    def __post_init__(self) -> None:
        if not 0 < self.min_us < self.trim_us < self.max_us < 65535:
            raise ValueError(f"servo travel must rise, got {self}")

    def pulse(self, unit: float) -> int:
        """Return the pulse in whole us for a deflection from -1 to 1, clipped to the travel."""
        shaft = -unit if self.reverse else unit
        travel = self.max_us - self.trim_us if shaft > 0 else self.trim_us - self.min_us
        return min(max(self.trim_us + round(shaft * travel), self.min_us), self.max_us)

    def unit(self, pulse_us: int) -> float:
        """Return the deflection of a pulse: the inverse of ArduPilot's pwm_from_angle."""
        shaft = pulse_us - self.trim_us
        travel = self.max_us - self.trim_us if shaft > 0 else self.trim_us - self.min_us
        return (-shaft if self.reverse else shaft) / travel


@dataclass(frozen=True, slots=True)
class Leg:
    """One leg. Most fields apply to all kinds: a turn may climb, and an idle leg may be gusty.

    ``kind`` is one of manoeuvre, idle, turn, climb, speed, gust, landing and go_around. ``shape``
    and ``amplitude`` (rudder units) are those of a manoeuvre. ``speed_kt`` is held from this leg on
    (0: as before). ``climb_ft_min`` is flown until ``to_ft``, if given. ``rudder_hold`` is a steady
    rudder, positive to the right.
    MANUAL needs level wings at its beginning, so an idle leg should precede it, not a turn.
    ``severity`` is that of the turbulence (MIL-F-8785C, 0 to 7). ``gust_m_s`` is the peak of one
    side gust, a (1 - cos) of ``gust_s``; the seed draws its side, its time and a factor of its size
    from 0.7 to 1.3.
    """

    kind: str
    seconds: float
    mode: str = "FBWA"
    shape: str = "3211"
    amplitude: float = 0.15
    speed_kt: float = 0.0
    bank_deg: float = 0.0
    climb_ft_min: float = 0.0
    to_ft: float = math.nan
    rudder_hold: float = 0.0
    severity: int = 0
    gust_m_s: float = 0.0
    gust_s: float = 2.0


@dataclass(frozen=True, slots=True)
class FlightPlan:
    """All settings of a flight.

    ``speed_kt`` is the calibrated airspeed, ``altitude_ft`` above sea level, ``heading_deg`` at the
    start. ``roll_gain`` and ``roll_rate_gain`` are the roll hold: aileron units per rad of roll and
    per rad/s. ``amplitude`` is in rudder units about trim; ``step_s`` is the manoeuvre's unit of
    time in s, best 0.3 periods of the Dutch roll. With ``true_feedback`` the autopilot's sensors
    have no noise. ``parameters`` are sent next to those of the servos. ``own`` are names and values
    of a linear aircraft (flights/linear.py) that has no entry in sealed.toml. With ``legs`` they
    are flown in place of a manoeuvre.

    Raises:
        ValueError: the manoeuvre is unknown, or a number is outside its limits.
    """

    aircraft: str = "c172p"
    speed_kt: float = 100.0
    altitude_ft: float = 3000.0
    heading_deg: float = 90.0
    seconds: float = 120.0
    manoeuvre: str = "3211"
    amplitude: float = 0.2
    step_s: float = 0.78
    roll_gain: float = 1.0
    roll_rate_gain: float = 0.3
    true_feedback: bool = False
    rudder: Servo = field(default_factory=Servo)
    aileron: Servo = field(default_factory=Servo)
    parameters: tuple[tuple[str, float], ...] = ()
    own: tuple[tuple[str, float], ...] = ()
    legs: tuple[Leg, ...] = ()

    def __post_init__(self) -> None:
        if self.legs:
            object.__setattr__(self, "seconds", sum(leg.seconds for leg in self.legs))
            object.__setattr__(self, "manoeuvre", "none")
        if self.manoeuvre not in MANOEUVRES:
            raise ValueError(f"manoeuvre must be one of {', '.join(MANOEUVRES)}")
        for name in ("speed_kt", "seconds", "amplitude", "step_s"):
            if not 0.0 < getattr(self, name) < math.inf:
                raise ValueError(f"{name} must be > 0 and finite, got {getattr(self, name)!r}")

    def speeds_kt(self) -> list[float]:
        """Return the calibrated airspeed in kt that each leg holds."""
        asked = (leg.speed_kt for leg in self.legs)
        held = accumulate(asked, lambda before, now: now or before, initial=self.speed_kt)
        return list(held)[1:]


def count(seconds: float) -> int:
    """Return the number of milliseconds in a log of this length, both ends included."""
    return round(seconds / STEP_S) + 1


def excitation(plan: FlightPlan) -> Floats:
    """Return the rudder about trim for every simulation step (n,), in units."""
    n = count(plan.seconds)
    left = max(n - round(LEAD_IN_S / STEP_S), 0)
    if plan.manoeuvre == "sweep":
        moves = _sweep(left, plan.step_s)
    else:
        pieces = manoeuvre_pieces(plan.manoeuvre, plan.step_s)
        once = [np.full(round(length_s / STEP_S), side) for length_s, side in pieces]
        moves = np.resize(np.concatenate([*once, []]), left)
    return np.concatenate([np.zeros(n - left), plan.amplitude * moves])


def _sweep(n: int, step_s: float) -> Floats:
    """Return sines (n,) from 0.3 to 2.5 times the frequency whose period is ``step_s / 0.3``.

    Each sweep of SWEEP_S rises exponentially in frequency; every second one begins to the left.
    """
    t = np.arange(n) * STEP_S
    low_hz, octaves = 0.3 * 0.3 / step_s, np.log(2.5 / 0.3)
    phase = math.tau * low_hz * SWEEP_S / octaves * np.expm1(octaves * (t % SWEEP_S) / SWEEP_S)
    return np.asarray(np.where(t // SWEEP_S % 2 == 0, 1.0, -1.0) * np.sin(phase))


def manoeuvre_pieces(manoeuvre: str, step_s: float) -> list[tuple[float, float]]:
    """Return one sequence of a manoeuvre as pieces (length in s, side: -1, 0 or 1)."""
    if manoeuvre == "none":
        return []
    if manoeuvre == "prbs":
        bits, _ = max_len_seq(9)
        return [(step_s / 2, 2.0 * bit - 1.0) for bit in bits]
    one = [(5 / 3, 1), (5 / 3, -1), (5, 0)]  # half a period each way
    if manoeuvre == "3211":
        one = [(3, 1), (2, -1), (1, 1), (1, -1), (4, 0)]
    # Both signs and three tempos, so that no two repetitions excite the same band.
    turns = [(sign, tempo) for tempo in (1.0, 0.7, 1.3) for sign in (1, -1)]
    return [
        (length * tempo * step_s, float(value * sign))
        for sign, tempo in turns
        for length, value in one
    ]


MODES = {"MANUAL": 0, "FBWA": 5}
"""ArduPlane's custom_mode by name; FBWA has the roll hold, in MANUAL the aileron is held still."""
BEFORE_S, AFTER_S = 2.0, 8.0
"""Time in s of still rudder at the ends of a manoeuvre leg. The last 8 s contain the free decay and
5 s of rest."""
LONGEST_REST_S = 4.0
"""Longest rest in s between the moves of one manoeuvre; 5 s of rest would end it."""
STIR_S = 0.5
"""Time in s in which ``rudder_hold`` rises at the beginning of a leg and falls at its end."""


def rudder_moves(leg: Leg, step_s: float) -> Floats:
    """Return the rudder about trim for every millisecond of a leg (n,), in units.

    The leg has as many whole sequences of the manoeuvre as fit; a PRBS fills it.
    """
    moves = np.zeros(round(leg.seconds / STEP_S))
    first, room = round(BEFORE_S / STEP_S), round((leg.seconds - BEFORE_S - AFTER_S) / STEP_S)
    if leg.kind != "manoeuvre":
        foot = round(STIR_S / STEP_S)
        ends = np.minimum(np.arange(len(moves)), np.arange(len(moves))[::-1]) / foot
        return np.asarray(leg.rudder_hold * np.minimum(ends, 1.0))
    at = complete = first
    for length_s, value in cycle(manoeuvre_pieces(leg.shape, step_s)):
        stop = at + round((length_s if value else min(length_s, LONGEST_REST_S)) / STEP_S)
        if value and stop > first + room:
            break
        moves[at:stop] = value * leg.amplitude
        if leg.shape == "prbs" or not value:
            complete = stop
        at = stop
    moves[complete:] = 0.0
    return moves


def read_plan(name: str) -> FlightPlan:
    """Return the plan of this name, or that of a TOML file.

    Raises:
        ValueError: the file has an unknown field or a wrong value.
        OSError: there is no such plan, or the file cannot be read.
    """
    path = Path(name) if name.endswith(".toml") else PLANS / f"{name}.toml"
    try:
        found = tomllib.loads(path.read_text(encoding="utf-8"))
        legs = tuple(Leg(**leg) for leg in found.pop("leg", []))
        return FlightPlan(**found, legs=legs)
    except TypeError as error:
        raise ValueError(f"{name}: {error}") from error


PLANS = Path(__file__).parent / "plans"
"""The folder of the named plans."""


PATH = Path(__file__).with_name("sealed.toml")


def sealed_places() -> list[Place]:
    """Return name, altitude in ft and airspeed in kt of the sealed aircraft, each at its speeds."""
    return _places("jsbsim", "linear")


def nonlinear_places() -> list[Place]:
    """Return the places of the file's opened aircraft, on which a limit may be chosen."""
    return _places("nonlinear")


def _places(*kinds: str) -> list[Place]:
    return [
        (each["aircraft"], each.get("altitude_ft", 1000.0), knots)
        for each in _entries(*kinds)
        for knots in each.get("speeds_kt") or [round(each["airspeed_m_s"] / KNOT, 3)]
    ]


def _entries(*kinds: str) -> list[dict[str, Any]]:
    own = tomllib.loads(PATH.read_text(encoding="utf-8"))
    return [each for kind in kinds for each in own.get(kind, ())]


def sealed(name: str) -> dict[str, Any]:
    """Return what the file has about an aircraft, sealed or opened; {} if it does not have it."""
    every = _entries("jsbsim", "linear", "nonlinear")
    return next((each for each in every if each["aircraft"] == name), {})


def plan_at(place: Place, **given: Any) -> FlightPlan:
    """Return the plan of a flight at a place, with the roll hold that a sealed aircraft needs."""
    name, feet, knots = place
    own = sealed(name)
    if gain := own.get("roll_gain"):
        given |= {"roll_gain": gain, "roll_rate_gain": own.get("roll_rate_gain", 0.3 * gain)}
    return FlightPlan(aircraft=name, altitude_ft=feet, speed_kt=knots, **given)
