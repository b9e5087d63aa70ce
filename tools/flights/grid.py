"""The flights of ``bench.py truth``: aircraft, speeds, manoeuvres, air, gyro and rates in turn."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
from cases.recipes import Made
from numpy.typing import NDArray

from flights.flight import STEP_S, FlightPlan, excitation
from flights.free import AIRCRAFT, FreeFlight, Hands
from flights.surgery import join
from flights.telemetry import KNOT, Link, telemetry
from flights.truth import after_lead_in, at_airspeeds, linear_dutch_rolls, truth_lines

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
    flown = FreeFlight(plan, Hands(rudder=rudder), severity, seed=link.seed)
    log = join(telemetry(plan, link, flown))
    conditions = {
        "aircraft": aircraft, "speed_kt": speed_kt, "manoeuvre": plan.manoeuvre,
        "severity": severity, "gyro": name, "rate_hz": hz, "amplitude": plan.amplitude,
        "seconds": plan.seconds, "seed": seed, "number": number,
    }  # fmt: skip
    return Made(log, conditions | truth_of(plan, link, flown))


def truth_of(plan: FlightPlan, link: Link, flight: FreeFlight) -> dict[str, Any]:
    """Return what should be found at any airspeed of a flight: see :func:`dutch_roll_at`.

    It is that of :func:`jsbsim_truth.truth_lines`, with ``flown``: boot seconds and kt.
    """
    line = truth_lines(plan, after_lead_in(flight.flown))["dutch_roll"]
    assert line is not None, plan
    told = [[round(s + link.boot_s, 2), round(kt, 3)] for s, kt, _, _ in flight.flown]
    return line | {"mean_m_s": line["mean_kt"] * KNOT, "flown": told}


def dutch_roll_at(truth: dict[str, Any], from_s: float, to_s: float) -> tuple[Floats, Floats]:
    """Return wn in rad/s and zeta (2,) at the mean airspeed flown between two boot times.

    The second is their sigma (2,): that of the airspeed flown, and how far the pulse is off.
    """
    flown = np.array(truth["flown"])
    return at_airspeeds(truth, flown[(flown[:, 0] >= from_s) & (flown[:, 0] <= to_s), 1])
