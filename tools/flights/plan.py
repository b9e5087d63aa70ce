"""A flight and its telemetry link as data, and the sealed aircraft: on none is a limit chosen."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from msgspec import Meta
from numpy.typing import NDArray
from scipy.signal import chirp, max_len_seq

STEP_S = 0.001  # boot time counts milliseconds: every message falls on a step
SENSED = (
    *(f"attitude/{angle}-rad" for angle in ("phi", "theta", "psi")),
    *(f"velocities/{axis}-rad_sec" for axis in "pqr"),
)
"""The quantities that the autopilot senses and ATTITUDE reports, in this order."""
SENSED_MS = 20
"""The autopilot reads its sensors at 50 Hz, as ArduPlane's loop does: their noise changes then."""
LEAD_IN_S = 5.0  # the flight starts at trim, while a receiver finds vehicle and parameters
SHAPES = {
    "3211": ((3, 1), (2, -1), (1, 1), (1, -1), (4, 0)),
    "doublets": ((5 / 3, 1), (5 / 3, -1), (5, 0)),  # half a period each way
    "none": (),
}
"""Manoeuvres as pieces: their length in the plan's units of time, and their side."""
SWEEP_S = 45.0  # length of one sweep
KNOT, FOOT = 0.514444, 0.3048
Floats = NDArray[np.float64]
Place = tuple[str, float, float]
"""Name of an aircraft, altitude in ft and calibrated airspeed in kt."""
Positive = Annotated[float, Meta(gt=0.0, le=1e9)]
NotNegative = Annotated[float, Meta(ge=0.0, le=1e9)]
RateHz = Annotated[float, Meta(gt=0.0, le=200.0)]
"""Limits of settings, which the command line keeps (fly_jsbsim.py)."""


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
        moved_us = round(shaft * self._travel_us(shaft))
        return min(max(self.trim_us + moved_us, self.min_us), self.max_us)

    def unit(self, pulse_us: int) -> float:
        """Return the deflection of a pulse: the inverse of ArduPilot's pwm_from_angle."""
        shaft = pulse_us - self.trim_us
        return (-shaft if self.reverse else shaft) / self._travel_us(shaft)

    def _travel_us(self, shaft: float) -> int:
        """Return the travel on the side to which the shaft is turned."""
        return self.max_us - self.trim_us if shaft > 0 else self.trim_us - self.min_us


@dataclass(frozen=True, slots=True)
class FlightPlan:
    """All settings of a flight.

    ``speed_kt`` is the calibrated airspeed, ``altitude_ft`` above sea level, ``heading_deg`` at the
    start. ``roll_gain`` and ``roll_rate_gain`` are the roll hold: aileron units per rad of roll and
    per rad/s. ``manoeuvre`` is 3211, doublets, prbs, sweep or none; ``amplitude`` is in rudder
    units about trim, ``step_s`` its unit of time in s, best 0.3 periods of the Dutch roll. With
    ``true_feedback`` the autopilot's sensors have no noise. ``rudder`` and ``aileron`` are servos
    (MIN,TRIM,MAX[,REVERSED] in us on the command line). ``parameters`` are sent next to those of
    the servos. ``own`` are names and values of a linear aircraft (flights/linear.py) that has no
    entry in sealed.toml.
    """

    aircraft: str = "c172p"
    speed_kt: Positive = 100.0
    altitude_ft: float = 3000.0
    heading_deg: float = 90.0
    seconds: Positive = 120.0
    manoeuvre: Literal["3211", "doublets", "prbs", "sweep", "none"] = "3211"
    amplitude: Positive = 0.2
    step_s: Positive = 0.78
    roll_gain: float = 1.0
    roll_rate_gain: float = 0.3
    true_feedback: bool = False
    rudder: Servo = field(default_factory=Servo)
    aileron: Servo = field(default_factory=Servo)
    parameters: tuple[tuple[str, float], ...] = ()
    own: tuple[tuple[str, float], ...] = ()


@dataclass(frozen=True, slots=True)
class Link:
    """The settings of a telemetry link: what is sent, and with which noise.

    Rates are in Hz. ``rate_noise`` and ``angle_noise`` are the standard deviations of ATTITUDE's
    noise in rad/s and rad. ``boot_s`` is the vehicle's time at the start of the flight, and
    ``servo_ms`` when the first servo message is sent.
    """

    attitude_hz: RateHz = 50.0
    servo_hz: RateHz = 50.0
    rate_noise: NotNegative = 0.002
    angle_noise: NotNegative = 0.001
    boot_s: NotNegative = 30.0
    mavlink1: bool = False
    seed: int = 1
    servo_ms: int = 5

    @property
    def sigmas(self) -> list[float]:
        """The standard deviations of the noise of ATTITUDE's angles and rates (6,)."""
        return [self.angle_noise] * 3 + [self.rate_noise] * 3


def count(seconds: float) -> int:
    """Return the number of milliseconds in a log of this length, both ends included."""
    return round(seconds / STEP_S) + 1


def excitation(plan: FlightPlan) -> Floats:
    """Return the rudder about trim for every simulation step (n,), in units.

    A sweep rises exponentially from 0.3 to 2.5 times the frequency whose period is ``step_s / 0.3``
    within SWEEP_S; every second one begins to the left. Other manoeuvres are repeated, those of
    SHAPES to both sides and at three tempos, so that no two repetitions excite the same band.
    """
    n = count(plan.seconds)
    left = max(n - round(LEAD_IN_S / STEP_S), 0)
    match plan.manoeuvre:
        case "sweep":
            t = np.arange(left) * STEP_S
            side = np.where(t // SWEEP_S % 2 == 0, 1.0, -1.0)
            low_hz, high_hz = 0.3 * 0.3 / plan.step_s, 2.5 * 0.3 / plan.step_s
            moves = side * chirp(t % SWEEP_S, low_hz, SWEEP_S, high_hz, "logarithmic", phi=-90.0)
        case "prbs":
            bits, _ = max_len_seq(9)
            moves = np.repeat(2.0 * bits - 1.0, round(plan.step_s / 2 / STEP_S))
        case shape:
            turns = product((1.0, 0.7, 1.3), (1, -1), SHAPES[shape])
            pieces = [
                np.full(round(length * tempo * plan.step_s / STEP_S), float(side * sign))
                for tempo, sign, (length, side) in turns
            ]
            moves = np.concatenate([*pieces, []])
    return np.concatenate([np.zeros(n - left), plan.amplitude * np.resize(moves, left)])


PATH = Path(__file__).with_name("sealed.toml")


def sealed_places(*, opened: bool = False) -> list[Place]:
    """Return name, altitude in ft and airspeed in kt of the sealed aircraft, each at its speeds.

    With ``opened`` they are the file's opened aircraft instead, on which a limit may be chosen.
    """
    kinds = ["nonlinear"] if opened else ["jsbsim", "linear"]
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
    return {each["aircraft"]: each for each in every}.get(name, {})


def plan_at(place: Place, **given: Any) -> FlightPlan:
    """Return the plan of a flight at a place, with the roll hold that a sealed aircraft needs."""
    name, feet, knots = place
    gain = (own := sealed(name)).get("roll_gain", 1.0)
    rate_gain = own.get("roll_rate_gain", 0.3 * gain)
    return FlightPlan(name, knots, feet, roll_gain=gain, roll_rate_gain=rate_gain, **given)
