"""The flights of ``bench.py lateral``: JSBSim under a roll hold that hears the noisy signals.

A flight has three manoeuvres of the rudder. Its aileron follows the roll hold alone, or moves on
purpose as well. What is kept are arrays: the attitude at 25 Hz as ATTITUDE reports it, the servos'
outputs with their own stamps, and the bare aircraft linearised at each manoeuvre's mean speed.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from flights.flight import MILSPEC, PITCH_GAIN, PITCH_RATE_GAIN, Floats, jsbsim_rudder, trimmed
from flights.moved import PLACES
from flights.plan import FOOT, LEAD_IN_S, FlightPlan, Place, Servo, manoeuvre_pieces
from flights.sealed import plan_at
from flights.truth import LATERAL, lateral, linear_dutch_rolls

AILERONS = ("moved", "feedback")
SEVERITIES = (0, 1, 2)
FRESH = (
    ("global5000", 15000.0, 230.0), ("global5000", 15000.0, 280.0), ("B747", 15000.0, 260.0),
    ("B747", 15000.0, 310.0), ("787-8", 15000.0, 260.0), ("787-8", 15000.0, 310.0),
    ("Concorde", 15000.0, 300.0), ("Concorde", 15000.0, 350.0), ("MD11", 15000.0, 270.0),
    ("MD11", 15000.0, 320.0),
)  # fmt: skip
"""Places as PLACES, of aircraft on which nothing was ever chosen. Pulse and linearisation agree."""
PER_PLACE = len(SEVERITIES) * len(AILERONS)
"""Number of conditions at a place: after all of them they come again, with other noise."""
MANOEUVRES_S = 30.0
DT_S, SENSED_S, LOGGED_S = 0.001, 0.02, 0.04
AMPLITUDES = {"J3Cub": 0.08, "t6texan2": 0.12}
RUDDER, AILERON = 0.15, 0.08
"""Amplitudes in half travels, where ``AMPLITUDES`` has no other."""
GYRO_RAD_S, ANGLE_RAD = 0.003, 0.001
"""Standard deviation of the noise of rates and angles, which the roll hold hears."""
SAME_SPEED = 0.003
TURN_IN_S = 3.0


def of_number(seed: int, number: int, places: Sequence[Place]) -> dict[str, Any]:
    """Return flight ``number`` (from 0) of a seed as arrays, ``truth`` as JSON."""
    rest, place = divmod(number % (len(places) * PER_PLACE), len(places))
    aileron, severity = divmod(rest, len(SEVERITIES))
    name, _, knots = places[place]
    plan = plan_at(places[place])
    mode = linear_dutch_rolls(replace(plan, roll_gain=0.0, roll_rate_gain=0.0))["dutch_roll"]
    assert mode is not None, plan
    rng = np.random.default_rng([seed, number])
    rudder, moved = _moves(plan, 0.3 * math.tau / mode["wn_rad_s"], AILERONS[aileron] == "moved")
    flown = _fly(plan, rudder, moved, SEVERITIES[severity], rng)
    truths = _truths(plan, flown["attitude"])
    conditions = {
        "aircraft": name, "speed_kt": knots, "severity": SEVERITIES[severity],
        "aileron": AILERONS[aileron], "seed": seed, "number": number,
    }  # fmt: skip
    return flown | {"truth": json.dumps(conditions | {"manoeuvres": truths})}


def in_turn(place: int, bank: float, seed: int) -> dict[str, Any]:
    """Return the first manoeuvre of a calm flight at PLACES[place] in a steady bank in rad."""
    plan = plan_at(PLACES[place])
    mode = linear_dutch_rolls(replace(plan, roll_gain=0.0, roll_rate_gain=0.0))["dutch_roll"]
    assert mode is not None, plan
    n = round((LEAD_IN_S + MANOEUVRES_S) / DT_S)
    rudder, moved = (x[:n] for x in _moves(plan, 0.3 * math.tau / mode["wn_rad_s"], True))
    flown = _fly(plan, rudder, moved, 0, np.random.default_rng(seed), bank)
    return flown | {"truth": json.dumps({"manoeuvres": [{"start_s": LEAD_IN_S}]})}


def kept(
    folder: Path, name: str, seed: int, number: int, places: Sequence[Place]
) -> dict[str, Any]:
    """Return a flight from the folder; fly it and keep it by that name if it is not there yet."""
    path = folder / f"{name}_{seed}_{number:03d}.npz"
    if not path.exists():
        part = path.with_suffix(".part.npz")
        np.savez(part, **of_number(seed, number, places))
        part.replace(path)
    with np.load(path) as found:
        return {name: found[name] for name in found.files}


def _moves(plan: FlightPlan, step_s: float, aileron_too: bool) -> tuple[Floats, Floats]:
    """Return rudder and aileron about trim (n,), a value for each step of the simulation."""
    n = round(MANOEUVRES_S / DT_S)
    amplitude = AMPLITUDES.get(plan.aircraft, RUDDER)
    rudders, ailerons = [np.zeros(round(LEAD_IN_S / DT_S))], [np.zeros(round(LEAD_IN_S / DT_S))]
    for name, tempo, side in (("3211", 1.0, 1.0), ("3211", 0.75, -1.0), ("doublets", 1.0, 1.0)):
        pieces = [(1.0, 0.0), *((tempo * step_s * s, side * v) for s, v in _first(name))]
        rudders.append(amplitude * _steps(n, pieces))
        unit_s = 0.55 * step_s
        own = [(0.42 * MANOEUVRES_S, 0.0), (2 * unit_s, 1), (2 * unit_s, -1), (unit_s, 1)]
        ailerons.append(AILERON * side * aileron_too * _steps(n, [*own, (unit_s, -1)]))
    return np.concatenate(rudders), np.concatenate(ailerons)


def _first(name: str) -> list[tuple[float, float]]:
    pieces = manoeuvre_pieces(name, 1.0)
    return pieces[: 4 if name == "3211" else 2]


def _steps(n: int, pieces: list[tuple[float, float]]) -> Floats:
    """Return pieces of (length in s, value) as (n,), then 0."""
    made, start = np.zeros(n), 0.0
    for length_s, value in pieces:
        made[round(start / DT_S) : round((start + length_s) / DT_S)] = value
        start += length_s
    return made


def _fly(
    plan: FlightPlan,
    rudder: Floats,
    moved: Floats,
    severity: int,
    rng: np.random.Generator,
    bank: float = 0.0,
) -> dict[str, Any]:
    """Fly; the hold banks by ``bank`` rad within the first TURN_IN_S and stays there."""
    fdm = trimmed(plan)
    fdm.set_dt(DT_S)
    if severity:
        fdm["atmosphere/randomseed"] = int(rng.integers(1, 2**31))
        fdm["atmosphere/turb-type"] = MILSPEC
        fdm["atmosphere/turbulence/milspec/severity"] = severity
    right = jsbsim_rudder(fdm["fcs/rudder-cmd-norm"])
    aileron, elevator = fdm["fcs/aileron-cmd-norm"], fdm["fcs/elevator-cmd-norm"]
    level, nose = fdm["attitude/phi-rad"], fdm["attitude/theta-rad"]
    servo, sensed, logged = Servo(), round(SENSED_S / DT_S), round(LOGGED_S / DT_S)
    later = int(rng.integers(0, logged))  # the servo messages come between those of the attitude
    attitude, servos = [], []
    for k in range(len(rudder)):
        roll, pitch = fdm["attitude/phi-rad"], fdm["attitude/theta-rad"]
        p, q, r = (fdm[f"velocities/{axis}-rad_sec"] for axis in "pqr")
        if k % sensed == 0:
            noise = rng.normal(size=5) * ([GYRO_RAD_S] * 3 + [ANGLE_RAD] * 2)
        held = level + bank * min(k * DT_S / TURN_IN_S, 1.0)
        hold = plan.roll_gain * (roll + noise[3] - held) + plan.roll_rate_gain * (p + noise[0])
        to_left = servo.unit(servo.pulse(aileron - hold + moved[k]))
        to_right = servo.unit(servo.pulse(right + rudder[k]))
        if k % logged == 0:
            speed, kt, feet = (fdm[name] for name in SPEEDS)
            heard = np.array([p, q, r, roll, pitch]) + noise
            attitude.append((k * DT_S, *heard, speed * FOOT, kt, feet))
        if k % logged == later:
            servos.append((k * DT_S, to_right, to_left))
        fdm["fcs/aileron-cmd-norm"], fdm["fcs/rudder-cmd-norm"] = to_left, jsbsim_rudder(to_right)
        hold_nose = PITCH_GAIN * (pitch - nose) + PITCH_RATE_GAIN * q
        fdm["fcs/elevator-cmd-norm"] = elevator + hold_nose
        fdm.run()
    return {"attitude": np.array(attitude), "servos": np.array(servos)}


SPEEDS = ("velocities/vt-fps", "velocities/vc-kts", "position/h-sl-ft")


def _truths(plan: FlightPlan, attitude: Floats) -> list[dict[str, Any]]:
    """Return the bare aircraft of each manoeuvre: A (4, 4) of beta, p, r, roll, and B (4, 2)."""
    found: list[dict[str, Any]] = []
    for number in range(3):
        start_s = LEAD_IN_S + number * MANOEUVRES_S
        its = (attitude[:, 0] >= start_s) & (attitude[:, 0] < start_s + MANOEUVRES_S)
        speed, kt, feet = attitude[its, 6:9].mean(0).tolist()
        near = [each for each in found if abs(kt / each["kt"] - 1.0) < SAME_SPEED]
        if not near:
            near = [_bare(replace(plan, speed_kt=round(kt, 2), altitude_ft=round(feet, 0)))]
        found.append(near[0] | {"start_s": start_s, "airspeed_m_s": speed})
    return found


def _bare(plan: FlightPlan) -> dict[str, Any]:
    A, aileron, rudder = lateral(trimmed(plan))
    rows = [LATERAL.index(name) for name in ("Beta", "P", "R", "Phi")]
    B = np.stack([aileron, -rudder], 1)[rows]
    return {"kt": plan.speed_kt, "A": A[np.ix_(rows, rows)].tolist(), "B": B.tolist()}
