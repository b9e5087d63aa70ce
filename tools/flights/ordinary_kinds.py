"""The ordinary flights of ``bench.py ordinary``: JSBSim's aircraft, small ones, and hostile logs.

Each flight has a random generator with its own seed: the same numbers give the same bytes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from flights.drawn import hovering, parked, taxiing, tumbling
from flights.flight import trimmed
from flights.fly import Made
from flights.moved import CONDITIONS, RATES_HZ, SEVERITIES
from flights.ordinary import LAWS, Ordinary, fly_ordinary
from flights.plan import KNOT, FlightPlan, Place, plan_at
from flights.telemetry import Link
from flights.truth import LATERAL, dutch_roll, lateral

SECONDS, ON_GROUND_S = 900.0, 400.0
HIGHEST_FT = 4000.0
"""Above it, there is no turbulence of severity 1 or 2 (MIL-F-8785C)."""
GYROS = (0.001, 0.003, 0.006)
LAGS_S = (0.0, 0.03, 0.06, 0.1)
MIXES = (0.5, 0.0, 0.3, 0.0)
SMALL_WN, SMALL_ZETA, SMALL_ROLL_S = (3.0, 12.0), (0.12, 0.31), (0.06, 0.15)
SMALL_TURNS_S = (15.0, 45.0)
NOT_DAMPED = 9
"""The number of JSBSim's aircraft whose zeta is below .45: all but the last, an A320."""
LINES = np.geomspace(0.3, 3.0, 11)
"""Frequencies of lines as multiples of wn."""


def _link(rng: np.random.Generator, hz: float, gyro: float) -> Link:
    """Return a link whose servo messages come at other times than the attitudes."""
    return Link(
        hz,
        hz,
        gyro,
        seed=int(rng.integers(1, 2**31)),
        servo_ms=int(rng.integers(5, int(1000 / hz))),
    )


def jsbsim(
    seed: int, number: int, seconds: float = SECONDS, places: Sequence[Place] = tuple(CONDITIONS)
) -> Ordinary:
    """Return flight ``number`` of a seed: aircraft and severity are a grid, rates come in turn."""
    rng = np.random.default_rng([seed, 0, number])
    names = list(dict.fromkeys(place[0] for place in places))
    turn, at = divmod(number, len(names))
    its = [place for place in places if place[0] == names[at]]
    speeds = [place[2] for place in its]
    knots = round(float(rng.uniform((min(speeds) + max(speeds)) / 2.0, max(speeds))), 1)
    plan = plan_at(
        (names[at], min(its[0][1], HIGHEST_FT), knots), seconds=SECONDS, manoeuvre="none"
    )
    step = turn + at
    return Ordinary(
        _gains(rng, plan),
        _link(rng, RATES_HZ[step % 3], GYROS[(at + 2 * turn) % 3]),
        severity=SEVERITIES[turn % 4],
        law=list(LAWS)[(step + turn // 3) % 3],
        mix=MIXES[(step + turn // 4) % 4],
        servo_lag_s=float(rng.choice(LAGS_S)),
        frozen=bool((at + turn // 2) % 2),
    )


def _gains(rng: np.random.Generator, plan: FlightPlan) -> FlightPlan:
    angle, rate = rng.uniform(0.6, 1.4), rng.uniform(0.4, 1.0)
    return replace(
        plan, heading_deg=float(rng.integers(0, 360)), roll_gain=round(angle * plan.roll_gain, 3),
        roll_rate_gain=round(rate * plan.roll_rate_gain, 4),
    )  # fmt: skip


def small(seed: int, number: int, seconds: float = SECONDS) -> Ordinary:
    """Return flight ``number`` of a seed by a small linear aircraft; their wn are spread evenly."""
    rng = np.random.default_rng([seed, 1, number])
    share = (number * 0.618034) % 1.0
    wn = SMALL_WN[0] * (SMALL_WN[1] / SMALL_WN[0]) ** share
    plan = replace(_small_aircraft(rng, wn), seconds=seconds)
    rates = [hz for hz in RATES_HZ if 2.5 * wn < 0.8 * math.pi * hz]
    return Ordinary(
        _gains(rng, plan),
        _link(rng, rates[number % len(rates)], 0.005),
        severity=SEVERITIES[number % 4],
        law=list(LAWS)[number // 3 % 3],
        mix=MIXES[number // 2 % 4],
        frozen=True,
        turns_s=SMALL_TURNS_S,
    )


def _small_aircraft(rng: np.random.Generator, wn: float) -> FlightPlan:
    """Return the plan of a small aircraft with a Dutch roll at about ``wn``."""
    while True:
        zeta, roll_s = (rng.uniform(*ends) for ends in (SMALL_ZETA, SMALL_ROLL_S))
        speed = rng.uniform(16.0, 22.0)
        own = {
            "airspeed_m_s": speed, "servo_lag_s": float(rng.choice(LAGS_S[1:])) / 2.0,
            "Y_beta": -rng.uniform(0.2, 0.6), "L_beta": -rng.uniform(0.5, 1.5) * wn**2,
            "L_p": -1.0 / roll_s, "L_r": rng.uniform(1.0, 3.0), "N_p": -rng.uniform(0.0, 0.6),
            "N_beta": rng.uniform(0.7, 1.0) * wn**2,
            "N_r": -2.0 * zeta * wn * rng.uniform(0.6, 1.1), "Y_delta_r": -0.1,
            "L_delta_a": rng.uniform(4.0, 7.0) / roll_s, "L_delta_r": -0.05 * wn**2,
            "N_delta_a": -rng.uniform(0.0, 2.0), "N_delta_r": 0.8 * wn**2,
        }  # fmt: skip
        hold = 2.5 / roll_s / own["L_delta_a"]
        plan = FlightPlan(
            "small", round(speed / KNOT, 2), 1000.0, manoeuvre="none",
            roll_gain=hold, roll_rate_gain=0.1 * hold, own=tuple(own.items()),
        )  # fmt: skip
        poles = np.linalg.eigvals(trimmed(plan).A)
        pair, real = poles[np.argmax(poles.imag)], poles.real[np.abs(poles.imag) < 1e-6]
        inside = (
            0.97 < abs(pair) / wn < 1.03
            and SMALL_ZETA[0] < -pair.real / abs(pair) < SMALL_ZETA[1]
            and SMALL_ROLL_S[0] < -1.0 / real.min() < SMALL_ROLL_S[1]
            and real.max() < 0.1
        )
        if inside:
            return plan


def hostile(seed: int, number: int, seconds: float = SECONDS) -> Made:
    """Return hostile log ``number`` of a seed: its family in turn, two of three by JSBSim."""
    nth, at = divmod(number, len(FAMILIES))
    family = list(FAMILIES)[at]
    rng = np.random.default_rng([seed, 2, number])
    make, which = (small, number) if nth % 3 == 2 else (jsbsim, 10 * number + nth % NOT_DAMPED)
    if change := FAMILIES[family]:
        made = fly_ordinary(change(rng, nth, make(seed, 1000 + which, seconds)))
    else:
        made = (hovering, taxiing, tumbling, parked)[nth % 4](rng, (min(seconds, ON_GROUND_S),))
    assert made.truth is not None
    return Made(made.log, {"dutch_roll_open_loop": None} | made.truth | {"family": family})


def _line(axes: str, nth: int, flight: Ordinary) -> Ordinary:
    """Return a flight with a line at one of LINES, which are multiples of wn."""
    wn, _ = _bare(flight)
    line = axes, float(LINES[nth % len(LINES)]) * wn, (0.3, 0.5, 1.0)[nth // 2 % 3]
    return replace(flight, line=line)


def _damped(zeta: float, flight: Ordinary) -> Ordinary:
    """Return a flight with a damper that adds about this zeta."""
    wn, effect = _bare(flight)
    return replace(flight, damper=2.0 * zeta * wn / effect)


def _bare(flight: Ordinary) -> tuple[float, float]:
    """Return wn in rad/s and N_delta_r of the bare aircraft at the plan's airspeed."""
    A, _, rudder = lateral(trimmed(flight.plan))
    mode = dutch_roll(A, rudder, LATERAL.index("R"))
    assert mode is not None
    return mode["wn_rad_s"], -float(rudder[LATERAL.index("R")])


def _stiff(plan: FlightPlan) -> FlightPlan:
    return replace(plan, roll_gain=2.5 * plan.roll_gain, roll_rate_gain=0.1 * plan.roll_gain)


FAMILIES: dict[str, Callable[[np.random.Generator, int, Ordinary], Ordinary] | None] = {
    "line in p": lambda rng, nth, flight: _line("p", nth, flight),
    "line in r": lambda rng, nth, flight: _line("r", nth, flight),
    "line in p and r": lambda rng, nth, flight: _line("pr", nth, flight),
    "limit cycle": lambda rng, nth, flight: replace(
        flight, plan=_stiff(flight.plan), law="hold", backlash=0.03
    ),
    "yaw damper": lambda rng, nth, flight: _damped(rng.uniform(0.1, 0.4), flight),
    "no turns": lambda rng, nth, flight: replace(flight, turns_s=None),
    "hover, taxi, tumble, parked": None,
    "aileron of wrong scale": lambda rng, nth, flight: replace(
        flight, sent_aileron=(-1.0, 0.4, -0.6, 0.7)[nth % 4]
    ),
    "roll late by .1 s": lambda rng, nth, flight: replace(flight, late_ms=100),
    "r scaled": lambda rng, nth, flight: replace(flight, sent_r=(1.2, 0.8)[nth % 2]),
}
"""What makes a flight one of a hostile family; None: nothing flies."""
