"""Tlogs of a linear aircraft that may be another one in each manoeuvre, or from within one.

It is one of linear_flights. Each manoeuvre has the rudder's 3-2-1-1, the aileron's doublet and a
rest.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import linear_flights
import numpy as np
from linear_flights import Floats, Plant, airframe, modes, plant

TICK_S, BEFORE, PER_LEG = 0.02, 500, 1300
GUST_RATE = 0.3
LIGHT = {
    "Y_beta": -0.25, "L_beta": -9.0, "L_p": -4.0, "L_r": 1.2, "L_delta_a": 8.0, "L_delta_r": -0.5,
    "N_beta": 5.5, "N_p": -0.15, "N_r": -0.6, "N_delta_a": 0.1, "N_delta_r": 2.5,
}  # fmt: skip
"""A light aircraft at 50 m/s."""
POWERS = dict.fromkeys(LIGHT, 2) | dict.fromkeys(("Y_beta", "L_p", "L_r", "N_p", "N_r"), 1)
SHAPE = (
    (0.0, 0.0, 1.0), (0.0, 1.0, 1.9), (0.0, -1.0, 1.3), (0.0, 1.0, 0.65), (0.0, -1.0, 0.65),
    (0.0, 0.0, 2.0), (1.0, 0.0, 1.0), (-1.0, 0.0, 1.0),
)  # fmt: skip
"""Aileron, rudder, and the length in 2 / wn."""


class Leg(NamedTuple):
    """A manoeuvre: what the aircraft is in it, and ``later``, from the share ``at`` of it on.

    ``told_m_s`` is the airspeed in the log where it is another one than that flown, NaN for none.
    """

    aircraft: Mapping[str, float] = LIGHT
    airspeed_m_s: float = 50.0
    told_m_s: float | None = None
    later: Mapping[str, float] | None = None
    at: float = 0.5


def at_speed(airspeed_m_s: float, of: Mapping[str, float] = LIGHT) -> dict[str, float]:
    """Return the derivatives at another airspeed than 50 m/s."""
    return {name: x * (airspeed_m_s / 50.0) ** POWERS[name] for name, x in of.items()}


def dutch_roll(of: Mapping[str, float] = LIGHT, airspeed_m_s: float = 50.0) -> tuple[float, float]:
    """Return wn in rad/s and zeta."""
    return modes(airframe(of, 0.0, airspeed_m_s)[0])[:2]


def tlog(
    legs: Sequence[Leg],
    seed: int = 1,
    *,
    manual: bool = False,
    hold: tuple[float, float] = (0.3, 0.05),
    lag_s: float = 0.05,
    gust_rad: float = 0.0,
    rudder: float = 0.15,
    aileron: float = 0.12,
    rate_hz: int = 25,
) -> bytes:
    """Return the log, servos at 50 Hz. ``hold`` are the gains of roll and p in FBWA.

    In ``manual`` nothing but the sticks moves the surfaces. Gusts have the sideslip ``gust_rad``.
    """
    moves = [_moves(leg, rudder, aileron) for leg in legs]
    plants = [its for leg in legs for its in _plants(leg, lag_s, gust_rad)]
    said = [leg.airspeed_m_s if leg.told_m_s is None else leg.told_m_s for leg in legs]
    return linear_flights.tlog(
        np.random.default_rng(seed), np.concatenate([np.zeros((BEFORE, 2)), *moves]),
        plants[:1] * BEFORE + plants, said[:1] * BEFORE + list(np.repeat(said, PER_LEG)),
        hold=(0.0, 0.0) if manual else hold, mode=0 if manual else linear_flights.FBWA,
        every=50 // rate_hz,
    )  # fmt: skip


def _plants(leg: Leg, lag_s: float, gust_rad: float) -> list[Plant]:
    """Return what flies in each tick of the leg."""
    each = (leg.aircraft, leg.aircraft if leg.later is None else leg.later)
    airframes = [airframe(of, 0.0, leg.airspeed_m_s) for of in each]
    first, later = (plant(A, B, lag_s, GUST_RATE, gust_rad, TICK_S) for A, B in airframes)
    since = round(leg.at * PER_LEG)
    return [first] * since + [later] * (PER_LEG - since)


def _moves(leg: Leg, rudder: float, aileron: float) -> Floats:
    """Return what the pilot wants of aileron and rudder (n, 2), at last nothing."""
    unit_s = 2.0 / dutch_roll(leg.aircraft, leg.airspeed_m_s)[0]
    at_s, found = 0.0, np.zeros((PER_LEG, 2))
    for own, side, length in SHAPE:
        first, stop = (round(t / TICK_S) for t in (at_s, at_s + length * unit_s))
        found[first:stop] = own * aileron, side * rudder
        at_s += length * unit_s
    return found
