"""A flight as data, and the sealed aircraft, on which no limit is ever chosen."""

from __future__ import annotations

import math
import tomllib
from dataclasses import dataclass, field
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
class FlightPlan:
    """All settings of a flight.

    ``speed_kt`` is the calibrated airspeed, ``altitude_ft`` above sea level, ``heading_deg`` at the
    start. ``roll_gain`` and ``roll_rate_gain`` are the roll hold: aileron units per rad of roll and
    per rad/s. ``amplitude`` is in rudder units about trim; ``step_s`` is the manoeuvre's unit of
    time in s, best 0.3 periods of the Dutch roll. With ``true_feedback`` the autopilot's sensors
    have no noise. ``parameters`` are sent next to those of the servos. ``own`` are names and values
    of a linear aircraft (flights/linear.py) that has no entry in sealed.toml.

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

    def __post_init__(self) -> None:
        if self.manoeuvre not in MANOEUVRES:
            raise ValueError(f"manoeuvre must be one of {', '.join(MANOEUVRES)}")
        for name in ("speed_kt", "seconds", "amplitude", "step_s"):
            if not 0.0 < getattr(self, name) < math.inf:
                raise ValueError(f"{name} must be > 0 and finite, got {getattr(self, name)!r}")


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
