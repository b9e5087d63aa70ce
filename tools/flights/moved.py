"""Flights whose rudder is moved on purpose, half of them in turbulence; how controls move.

Each flight has a random generator with its own seed: the same numbers give the same bytes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import lfilter

from flights.flight import Flight, Hands
from flights.fly import Made, fly
from flights.linear import GRAVITY
from flights.plan import (
    KNOT,
    LEAD_IN_S,
    STEP_S,
    FlightPlan,
    Floats,
    Link,
    Place,
    count,
    excitation,
    plan_at,
)
from flights.truth import linear_dutch_rolls

KEPT = 0.9960080
"""The part of its output that the washout of ArduPlane's yaw damper keeps at each call."""
UNITS = 180.0 / math.pi / 45.0
"""Units of rudder per rad/s: that damper works in degrees, of which 45 are one unit."""


def wander(rng: np.random.Generator, n: int, tau_s: float, std: float) -> Floats:
    """Return noise (n,), a value for each millisecond, filtered by two lags of ``tau_s``.

    ``std`` is the standard deviation of the process, from which that of a short piece may differ.
    """
    every = max(round(0.1 * tau_s / STEP_S), 1)
    pole = math.exp(-0.1)
    white = rng.normal(size=math.ceil(n / every) + 200)
    slow = lfilter([1.0], [1.0, -2.0 * pole, pole * pole], white)[199:]
    # Scale by the standard deviation of the process, not of this piece.
    slow *= std * math.sqrt((1.0 - pole**2) ** 3 / (1.0 + pole**2))
    return np.asarray(np.interp(np.arange(n) / every, np.arange(len(slow)), slow))


def pulses(rng: np.random.Generator, seconds: float, amplitude: float, unit_s: float) -> Floats:
    """Return moves to either side (n,), whose side is drawn every ``unit_s`` after the lead-in."""
    held = rng.choice([-amplitude, amplitude], size=math.ceil(seconds / unit_s) + 1)
    moves = np.repeat(held, round(unit_s / STEP_S))[: count(seconds)]
    moves[: round(LEAD_IN_S / STEP_S)] = 0.0
    return np.asarray(moves)


def by_hand(rng: np.random.Generator, n: int, amplitude: float, unit_s: float) -> Floats:
    """Return the rudder (n,) of a pilot's doublets, all different, with smooth edges and rests.

    ``unit_s`` is about the length of one side; a change of side takes 0.3 s.
    """
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
    """A rudder that copies the aileron: ``share`` of it with a lag of ``lag_s``."""

    share: float
    lag_s: float = 0.0
    now: float = 0.0

    def __call__(self, flight: Flight) -> float:
        """Return the rudder of this millisecond."""
        self.now += STEP_S / max(self.lag_s, STEP_S) * (self.share * flight.aileron - self.now)
        return self.now


@dataclass(slots=True)
class Damper:
    """A yaw damper: a rudder against the yaw rate, whose steady part a washout of 3 s removes."""

    gain: float
    slow: float = 0.0

    def __call__(self, flight: Flight) -> float:
        """Return the rudder of this millisecond."""
        r = flight.sensed(5)
        self.slow += STEP_S / 3.0 * (r - self.slow)
        return -self.gain * (r - self.slow)


@dataclass(slots=True)
class ArduPlanesDamper:
    """ArduPlane's yaw damper (AP_YawController.cpp) with the parameters of the flight's plan.

    Its output changes at SCHED_LOOP_RATE. The airspeed stays far from the limits of the scaling.
    """

    high: float = 0.0
    before: float = 0.0
    output: float = 0.0

    def __call__(self, flight: Flight) -> float:
        """Return the rudder of this millisecond."""
        own = dict(flight.plan.parameters)
        if flight.ms % round(1.0 / (own["SCHED_LOOP_RATE"] * STEP_S)) == 0:
            speed = flight["velocities/vc-kts"] * KNOT
            rate = flight.sensed(5) - own["YAW2SRV_RLL"] * GRAVITY / speed * math.sin(
                flight.sensed(0)
            )
            self.high, self.before = KEPT * self.high + rate - self.before, rate
            scaled = UNITS * (own["SCALING_SPEED"] / speed) ** 2
            self.output = -own["YAW2SRV_DAMP"] * scaled * self.high
        return self.output


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
"""Name, altitude in ft and calibrated airspeeds in kt of the aircraft. JSBSim can trim there, and
pulse and linearisation agree (flights/truth.py), so that the linearisation is the truth."""
CONDITIONS = [(name, feet, knots) for name, feet, speeds in AIRCRAFT for knots in speeds]
PLACES = [(name, feet, knots) for name, feet, ends in AIRCRAFT for knots in (ends[0], ends[-1])]
SHAPES = ("3211", "doublets", "sweep")
SEVERITIES = (0, 1, 2, 3)
"""Severities of MIL-F-8785C in the grid: half of the flights are calm, the others have 1 to 3 in
turn."""
GYROS = {"clean": 0.0005, "noisy": 0.008}
"""Standard deviation of the gyro's noise in rad/s."""
RATES_HZ = (10, 25, 50)
LINK_RATES_HZ = ((50, 50), (25, 25), (10, 10), (20, 20), (50, 25), (25, 10), (20, 10))
"""Rates of ATTITUDE and SERVO_OUTPUT_RAW in Hz, as pairs."""
PER_PLACE = len(SHAPES) * 2 * len(GYROS)
"""Number of flights of each place in the grid."""
AILERONS = ("moved", "feedback")
PER_PLACE_OF_AILERON = len(AILERONS) * (len(SEVERITIES) - 1)


@dataclass(frozen=True, slots=True)
class Draw:
    """The seed and the places of a corpus: a log's generator has (seed, kind, number)."""

    seed: int = 13
    places: Sequence[Place] = tuple(CONDITIONS)


CHOSEN = Draw()
"""The corpora on which limits are chosen."""


def of_grid(draw: Draw, number: int) -> Made:
    """Return flight ``number`` (0 to PER_PLACE for each place, less 1) of the grid.

    Aircraft, speed, manoeuvre, calm or turbulent air and gyro form a full grid; rates and
    severities come in turn. Amplitude (10 to 30 % of travel), length and heading are random. Limits
    were chosen with the seed 161.
    """
    rng = np.random.default_rng([draw.seed, number])
    gyro, gusty, shape, place = map(
        int, np.unravel_index(number, (len(GYROS), 2, len(SHAPES), len(draw.places)))
    )
    turn = place + shape + gyro + gusty
    severity = 1 + (turn + place // 2) % 3 if gusty else 0
    plan = _plan(rng, draw.places[place], SHAPES[shape], (70.0, 85.0, 100.0))
    rudder = excitation(plan)
    rudder[-8000:] = 0.0  # 8 s of rest
    hz, name = RATES_HZ[turn % len(RATES_HZ)], list(GYROS)[gyro]
    return fly(
        plan,
        Link(hz, hz, GYROS[name], seed=int(rng.integers(1, 2**31))),
        Hands(rudder),
        severity,
        gyro=name,
        rate_hz=hz,
    )


def excited(number: int, draw: Draw = CHOSEN) -> Made:
    """Return flight ``number`` of the excited corpus; even ones are calm, odd ones turbulent.

    Aircraft, speeds and manoeuvres come in turn. Amplitude, length, rates and noise are random; in
    one of four flights, on average, the aileron moves, too.
    """
    rng, half = np.random.default_rng([draw.seed, 0, number]), number // 2
    rounds, place = divmod(half, len(draw.places))
    manoeuvre = ("3211", "doublets", "prbs", "sweep")[(half + 2 * rounds) % 4]
    severity = 0 if number % 2 == 0 else 1 + half % 4
    plan = _plan(rng, draw.places[place], manoeuvre, (60.0, 80.0, 100.0, 120.0))
    stirred = rng.random() < 0.25
    aileron = pulses(rng, plan.seconds, float(rng.uniform(0.03, 0.08)), 0.4) if stirred else None
    return fly(
        plan,
        drawn_link(rng),
        Hands(excitation(plan), aileron),
        severity,
        group=f"severity {severity}" if severity else "calm",
    )


def with_aileron(draw: Draw, number: int) -> Made:
    """Return flight ``number`` of the bench ``lateral``; half of their ailerons are moved, too.

    Aircraft, speed, severity and aileron form a full grid; amplitude, length and heading are
    random. Sides of the aileron are drawn for .4 s each.
    """
    rng = np.random.default_rng([draw.seed, 3, number])
    aileron, severity, place = map(
        int, np.unravel_index(number, (len(AILERONS), len(SEVERITIES) - 1, len(draw.places)))
    )
    plan = _plan(rng, draw.places[place], "3211", (70.0, 85.0, 100.0))
    moves = pulses(rng, plan.seconds, 0.08, 0.4) if AILERONS[aileron] == "moved" else None
    return fly(
        plan,
        Link(25.0, 25.0, 0.003, seed=int(rng.integers(1, 2**31))),
        Hands(excitation(plan), moves),
        severity,
        aileron=AILERONS[aileron],
    )


def _plan(
    rng: np.random.Generator, place: Place, manoeuvre: str, lengths_s: tuple[float, ...]
) -> FlightPlan:
    plan = plan_at(
        place,
        heading_deg=float(rng.integers(0, 360)),
        seconds=float(rng.choice(lengths_s)),
        manoeuvre=manoeuvre,
        amplitude=round(float(rng.uniform(0.1, 0.3)), 3),
    )
    mode = linear_dutch_rolls(plan)["dutch_roll"]
    assert mode is not None, plan
    return replace(plan, step_s=round(0.3 * math.tau / mode["wn_rad_s"], 3))


def drawn_link(rng: np.random.Generator) -> Link:
    """Return a link with random rates, gyro noise and seed."""
    return Link(
        *LINK_RATES_HZ[rng.integers(len(LINK_RATES_HZ))],
        rate_noise=float(rng.choice([0.001, 0.002, 0.004, 0.008])),
        seed=int(rng.integers(1, 2**31)),
    )
