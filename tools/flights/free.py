"""Flights of JSBSim for the corpora: in turbulence, the nose held, the hands told what to do."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from cases.recipes import Made
from numpy.typing import NDArray
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from scipy.signal import lfilter

from flights.flight import LEAD_IN_S, STEP_S, Flight, FlightPlan, excitation
from flights.surgery import join
from flights.telemetry import KNOT, Link, telemetry
from flights.truth import after_lead_in, flown_dutch_rolls, linear_dutch_rolls

Floats = NDArray[np.float64]
MILSPEC = 3
"""JSBSim's atmosphere/turb-type of MIL-F-8785C."""
PITCH_GAIN, PITCH_RATE_GAIN = 1.0, 0.3
"""Elevator units per rad and rad/s that keep the nose where it was trimmed, and so the airspeed."""
SEED = 13
"""Of all that is drawn by chance: a log's generator is that of (SEED, kind, number)."""

AIRCRAFT: tuple[tuple[str, float, tuple[float, ...]], ...] = (
    ("c172p", 3000.0, (80.0, 90.0, 100.0, 110.0)),
    ("J3Cub", 2000.0, (50.0, 60.0, 70.0)),
    ("T37", 5000.0, (160.0, 200.0, 220.0)),
    ("t6texan2", 5000.0, (150.0, 180.0, 200.0)),
    ("OV10", 5000.0, (140.0, 180.0)),
    ("c172r", 3000.0, (80.0, 100.0)),
    ("737", 10000.0, (200.0, 250.0)),
    ("F80C", 8000.0, (220.0, 250.0)),
    ("T38", 10000.0, (270.0, 300.0)),
    ("A320", 10000.0, (220.0, 250.0)),
)
"""Name, altitude in ft, calibrated airspeeds in kt: where JSBSim trims, and pulse and linearisation
agree (tools/flights/truth.py), so that the linearisation is the truth."""
CONDITIONS = [(name, feet, knots) for name, feet, speeds in AIRCRAFT for knots in speeds]
ARMED = mavlink.MAV_MODE_FLAG_SAFETY_ARMED
LENGTHS_S = (60.0, 80.0, 100.0)
"""Of the logs without excitation."""
SHAPES = ("3211", "doublets", "prbs", "sweep")
RATES_HZ = ((50, 50), (25, 25), (10, 10), (20, 20), (50, 25), (25, 10), (20, 10))
"""Of ATTITUDE and SERVO_OUTPUT_RAW."""


@dataclass(slots=True)
class Hands:
    """What moves the controls besides the roll hold, by the millisecond.

    ``rudder`` and ``aileron`` in units about trim, ``bank`` the roll in rad that is held, each
    (n,) or nothing; ``react`` is asked each millisecond for more rudder, knowing the flight.
    """

    rudder: Floats | None = None
    aileron: Floats | None = None
    bank: Floats | None = None
    react: Callable[[FreeFlight], float] | None = None


class FreeFlight(Flight):
    """A flight in turbulence of a MIL-F-8785C severity (0: calm), its pitch held, hands on it."""

    def __init__(self, plan: FlightPlan, hands: Hands, severity: int = 0, seed: int = 1) -> None:
        n = count(plan.seconds)
        super().__init__(plan, np.zeros(n) if hands.rudder is None else hands.rudder)
        self._hands = hands
        self._still_aileron, self._level = self._aileron_trim, self._roll_trim
        self._moves = [_listed(column) for column in (hands.aileron, hands.bank)]
        fdm = self._fdm
        self._elevator, self._pitch = fdm["fcs/elevator-cmd-norm"], fdm["attitude/theta-rad"]
        if severity:
            fdm["atmosphere/randomseed"] = seed
            fdm["atmosphere/turb-type"] = MILSPEC
            fdm["atmosphere/turbulence/milspec/severity"] = severity

    @property
    def ms(self) -> int:
        """Milliseconds since the start."""
        return self._ms

    @property
    def aileron(self) -> float:
        """The aileron about trim in units, as its servo was told last."""
        return float(self._plan.aileron.unit(self.aileron_us) - self._still_aileron)

    def _step(self) -> None:
        fdm, ms, (aileron, bank) = self._fdm, self._ms, self._moves
        if aileron is not None:
            self._aileron_trim = self._still_aileron + aileron[ms]
        if bank is not None:
            self._roll_trim = self._level + bank[ms]
        if self._hands.react is not None:
            self._rudder[ms] += self._hands.react(self)
        nose = fdm["attitude/theta-rad"] - self._pitch
        damping = PITCH_RATE_GAIN * fdm["velocities/q-rad_sec"]
        fdm["fcs/elevator-cmd-norm"] = self._elevator + PITCH_GAIN * nose + damping
        super()._step()


def _listed(column: Floats | None) -> list[float] | None:
    return None if column is None else column.tolist()


def flown_log(plan: FlightPlan, link: Link, hands: Hands, severity: int = 0, **told: Any) -> Made:
    """Fly; return the log and its truth: the Dutch roll at the airspeeds and the altitude flown.

    The linearisation is closed with the roll hold that was flown, and with nothing that ``hands``
    feed back; ``dutch_roll_open_loop``, that of the airframe alone, is what a model finds that has
    the aileron as an input. ``told`` is told besides.

    Raises:
        FlightError: the aircraft cannot be trimmed or flown as asked.
    """
    flight = FreeFlight(plan, hands, severity, seed=link.seed)
    log = join(telemetry(plan, link, flight))
    flown = after_lead_in(flight.flown)
    speed_kt, altitude_ft = flown[:, 1:3].mean(axis=0).tolist()
    return Made(
        log,
        {
            "aircraft": plan.aircraft,
            **flown_dutch_rolls(plan, flown),
            "severity": severity,
            "seed": link.seed,
            "airspeed_m_s": round(speed_kt * KNOT, 3),
            "altitude_ft": round(altitude_ft, 1),
            "trimmed_kt": plan.speed_kt,
            "seconds": plan.seconds,
            "attitude_hz": link.attitude_hz,
            "servo_hz": link.servo_hz,
            "rate_noise": link.rate_noise,
        }
        | told,
    )


def drawn_link(rng: np.random.Generator) -> Link:
    """Return a link: its rates, its gyro's noise and its seed by chance."""
    attitude_hz, servo_hz = RATES_HZ[rng.integers(len(RATES_HZ))]
    noise = float(rng.choice([0.001, 0.002, 0.004, 0.008]))
    seed = int(rng.integers(1, 2**31))
    return Link(attitude_hz=attitude_hz, servo_hz=servo_hz, rate_noise=noise, seed=seed)


def excited(number: int) -> Made:
    """Return flight ``number`` of the excited corpus; even ones are calm, odd ones turbulent.

    Aircraft, speeds and manoeuvres come in turn; amplitude (10 to 30 % of travel), length, rates,
    noise and whether the aileron is moved too (in every fourth) by chance.
    """
    rng = np.random.default_rng([SEED, 0, number])
    aircraft, altitude_ft, speed_kt = CONDITIONS[number // 2 % len(CONDITIONS)]
    manoeuvre = SHAPES[(number // 2 + 2 * (number // 2 // len(CONDITIONS))) % len(SHAPES)]
    severity = 0 if number % 2 == 0 else 1 + number // 2 % 4
    plan = FlightPlan(
        aircraft=aircraft,
        speed_kt=speed_kt,
        altitude_ft=altitude_ft,
        heading_deg=float(rng.integers(0, 360)),
        seconds=float(rng.choice([60.0, 80.0, 100.0, 120.0])),
        manoeuvre=manoeuvre,
        amplitude=round(float(rng.uniform(0.1, 0.3)), 3),
    )
    mode = linear_dutch_rolls(plan)["dutch_roll"]
    assert mode is not None, plan
    plan = replace(plan, step_s=round(0.3 * math.tau / mode["wn_rad_s"], 3))
    hands, stirred = Hands(rudder=excitation(plan)), bool(rng.random() < 0.25)
    if stirred:
        hands.aileron = pulses(rng, plan.seconds, float(rng.uniform(0.03, 0.08)), 0.4)
    told = {"manoeuvre": manoeuvre, "amplitude": plan.amplitude, "aileron_too": stirred}
    group = f"severity {severity}" if severity else "calm"
    return flown_log(plan, drawn_link(rng), hands, severity, group=group, **told)


def count(seconds: float) -> int:
    """Return how many milliseconds a log of this length has."""
    return round(seconds / STEP_S) + 1


def wander(rng: np.random.Generator, n: int, tau_s: float, std: float) -> Floats:
    """Return noise (n,) by the millisecond that passed two lags of ``tau_s``, scaled to ``std``."""
    every = max(round(0.1 * tau_s / STEP_S), 1)
    white = rng.normal(size=math.ceil(n / every) + 200)
    pole = math.exp(-0.1)
    slow = lfilter([1.0], [1.0, -2.0 * pole, pole * pole], white)[199:]
    # By the process's own deviation: a short piece may move more or less, as chance has it.
    slow *= std * math.sqrt((1.0 - pole**2) ** 3 / (1.0 + pole**2))
    at = np.arange(n) / every
    return np.asarray(np.interp(at, np.arange(len(slow)), slow))


def pulses(rng: np.random.Generator, seconds: float, amplitude: float, unit_s: float) -> Floats:
    """Return moves to either side (n,), drawn anew every ``unit_s`` from the lead-in on."""
    n = count(seconds)
    held = rng.choice([-amplitude, amplitude], size=math.ceil(seconds / unit_s) + 1)
    moves = np.repeat(held, round(unit_s / STEP_S))[:n]
    moves[: round(LEAD_IN_S / STEP_S)] = 0.0
    return np.asarray(moves)


def by_hand(rng: np.random.Generator, seconds: float, amplitude: float, unit_s: float) -> Floats:
    """Return the rudder (n,) of a pilot's doublets: none the same, none square, rests between.

    ``unit_s`` is about the length of one side; the foot needs 0.3 s from stop to stop.
    """
    n = count(seconds)
    rudder, at = np.zeros(n), round(LEAD_IN_S / STEP_S)
    while at < n:
        sign = float(rng.choice([-1.0, 1.0]))
        for side in (sign, -sign, 0.0):
            length = round(unit_s * rng.uniform(0.6, 1.4) * (2.0 if side == 0.0 else 1.0) / STEP_S)
            rudder[at : at + length] = side * amplitude * rng.uniform(0.5, 1.0)
            at += length
    foot = np.hanning(301)
    return np.asarray(np.convolve(rudder, foot / foot.sum())[:n])


@dataclass(slots=True)
class Mixed:
    """Rudder that is the aileron's copy: ``share`` of it, ``lag_s`` later, and some noise (n,)."""

    share: float
    lag_s: float = 0.0
    noise: Floats | None = None
    _now: float = field(default=0.0, init=False)

    def __call__(self, flight: FreeFlight) -> float:
        """Return the rudder of this millisecond."""
        wanted = self.share * flight.aileron
        step = 1.0 if self.lag_s <= STEP_S else STEP_S / self.lag_s
        self._now += step * (wanted - self._now)
        return self._now + (0.0 if self.noise is None else float(self.noise[flight.ms]))


@dataclass(slots=True)
class Damper:
    """Rudder against the yaw rate, less what lasts: a yaw damper with its washout."""

    gain: float
    washout_s: float = 3.0
    _slow: float = field(default=0.0, init=False)

    def __call__(self, flight: FreeFlight) -> float:
        """Return the rudder of this millisecond."""
        r = flight["velocities/r-rad_sec"]
        self._slow += STEP_S / self.washout_s * (r - self._slow)
        return -self.gain * (r - self._slow)
