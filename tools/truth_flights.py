"""The flights of ``bench.py truth``: aircraft, speeds, manoeuvres, air, gyro and rates in turn."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
from case_recipes import Made
from corpus_flights import AIRCRAFT, FreeFlight, Hands
from jsbsim_flight import LEAD_IN_S, STEP_S, FlightPlan, excitation
from jsbsim_truth import linear_dutch_rolls, pulse_dutch_roll
from log_surgery import join
from numpy.typing import NDArray
from telemetry import KNOT, Link, telemetry

Floats = NDArray[np.float64]
TUNING, TABLE = 161, 162
"""Seeds: thresholds were chosen on the flights of the first, the table is of the second."""
SHAPES = ("3211", "doublets", "sweep")
SEVERITIES = (0, 1, 2, 3)
"""Of MIL-F-8785C; every other flight is calm, the others have 1, 2 and 3 in turn."""
GYROS = {"clean": 0.0005, "noisy": 0.008}
"""Standard deviation of what the gyro says, in rad/s."""
RATES_HZ = (10, 25, 50)
PLACES = [
    (name, feet, speed) for name, feet, speeds in AIRCRAFT for speed in (speeds[0], speeds[-1])
]
COUNT = len(PLACES) * len(SHAPES) * 2 * len(GYROS)
REST_S = 8.0
"""At the end, the rudder at trim."""


class NotedFlight(FreeFlight):
    """A flight that notes (second, calibrated airspeed in kt, altitude in ft) as it goes."""

    def times(self) -> Floats:
        """Return what was noted, (n, 3)."""
        seconds = (np.arange(len(self.flown)) + 1) * 0.25
        return np.column_stack([seconds, np.array(self.flown)])


def flight(seed: int, number: int) -> Made:
    """Return flight ``number`` (0 to COUNT - 1) of a seed, and its truth.

    Aircraft, speed, manoeuvre, air and gyro are a full grid, rates and severities come in turn;
    amplitude (10 to 30 % of travel), length and heading are the seed's.
    """
    rng = np.random.default_rng([seed, number])
    rest, place = divmod(number, len(PLACES))
    rest, shape = divmod(rest, len(SHAPES))
    gyro, gusty = divmod(rest, 2)
    turn = place + shape + gyro + gusty
    severity = 1 + (turn + place // 2) % 3 if gusty else 0
    aircraft, altitude_ft, speed_kt = PLACES[place]
    plan = FlightPlan(
        aircraft=aircraft,
        speed_kt=speed_kt,
        altitude_ft=altitude_ft,
        heading_deg=float(rng.integers(0, 360)),
        seconds=float(rng.choice([70.0, 85.0, 100.0])),
        manoeuvre=SHAPES[shape],
        amplitude=round(float(rng.uniform(0.1, 0.3)), 3),
    )
    mode = linear_dutch_rolls(plan)["dutch_roll"]
    assert mode is not None, plan
    plan = replace(plan, step_s=round(0.3 * math.tau / mode["wn_rad_s"], 3))
    rudder = excitation(plan)
    rudder[-round(REST_S / STEP_S) :] = 0.0
    hz, name = RATES_HZ[turn % len(RATES_HZ)], list(GYROS)[gyro]
    link = Link(hz, hz, rate_noise=GYROS[name], seed=int(rng.integers(1, 2**31)))
    flown = NotedFlight(plan, Hands(rudder=rudder), severity, seed=link.seed)
    log = join(telemetry(plan, link, flown))
    conditions = {
        "aircraft": aircraft, "speed_kt": speed_kt, "manoeuvre": plan.manoeuvre,
        "severity": severity, "gyro": name, "rate_hz": hz, "amplitude": plan.amplitude,
        "seconds": plan.seconds, "seed": seed, "number": number,
    }  # fmt: skip
    return Made(log, conditions | truth_of(plan, link, flown.times()))


def truth_of(plan: FlightPlan, link: Link, flown: Floats) -> dict[str, Any]:
    """Return what should be found at any airspeed of a flight: see :func:`dutch_roll_at`.

    ``flown`` (n, 3) are seconds, kt and ft. ``line`` is the Dutch roll linearised with the roll
    hold at the mean airspeed, wn and zeta, and their slopes by the airspeed in kt, over one
    standard deviation to either side; ``pulse`` how far the decay after a pulse, in the simulation
    itself, its actuators included, lies from it.
    """
    moved = flown[flown[:, 0] > LEAD_IN_S]
    _, mean_kt, feet = moved.mean(axis=0).tolist()
    spread_kt = max(float(moved[:, 1].std()), 0.1)
    mean = replace(plan, speed_kt=mean_kt, altitude_ft=feet)
    speeds = mean_kt + np.array([-spread_kt, 0.0, spread_kt])
    low, middle, high = (_mode(linear_dutch_rolls(replace(mean, speed_kt=v))) for v in speeds)
    seen = pulse_dutch_roll(mean)
    assert seen is not None, plan
    return {
        "mean_kt": mean_kt,
        "mean_m_s": mean_kt * KNOT,
        "line": {"at": middle.tolist(), "per_kt": ((high - low) / (2.0 * spread_kt)).tolist()},
        "pulse": (np.array([seen["wn_rad_s"], seen["zeta"]]) - middle).tolist(),
        "flown": [[round(s + link.boot_s, 2), round(v, 3)] for s, v in flown[:, :2].tolist()],
    }


def _mode(found: dict[str, dict[str, float] | None]) -> Floats:
    mode = found["dutch_roll"]
    assert mode is not None
    return np.array([mode["wn_rad_s"], mode["zeta"]])


def dutch_roll_at(truth: dict[str, Any], from_s: float, to_s: float) -> tuple[Floats, Floats]:
    """Return wn in rad/s and zeta (2,) at the mean airspeed flown between two boot times.

    The second is their sigma (2,): that of the airspeed flown, and how far the pulse is off.
    """
    flown = np.array(truth["flown"])
    knots = flown[(flown[:, 0] >= from_s) & (flown[:, 0] <= to_s), 1]
    at, slope = np.array(truth["line"]["at"]), np.array(truth["line"]["per_kt"])
    value = at + slope * (float(knots.mean()) - truth["mean_kt"])
    return value, np.hypot(slope * float(knots.std()), truth["pulse"])
