"""Tlogs of a linear aircraft that may be another one in each manoeuvre, or from within one.

x' = A x + B u of [beta, p, r, roll] and of [aileron, rudder], which are in half travels behind
servos of first order. Each manoeuvre has the rudder's 3-2-1-1, the aileron's doublet and a rest.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from flightlog import FlightLog
from numpy.typing import NDArray
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from scipy.linalg import expm

Floats = NDArray[np.float64]
TICK_S, START_S, BEFORE_S, LEG_S = 0.02, 20.0, 10.0, 26.0
GYRO_RAD_S, ROLL_RAD, TRAVEL_US, GRAVITY = 0.003, 0.001, 400, 9.80665
LIGHT = {
    "Y_beta": -0.25, "L_beta": -9.0, "L_p": -4.0, "L_r": 1.2, "L_delta_a": 8.0, "L_delta_r": -0.5,
    "N_beta": 5.5, "N_p": -0.15, "N_r": -0.6, "N_delta_a": 0.1, "N_delta_r": 2.5,
}  # fmt: skip
"""A light aircraft at 50 m/s."""
ARMED, PARAMETERS = 128, {
    "SERVO4_FUNCTION": 21, "SERVO4_MIN": 1100, "SERVO4_TRIM": 1500, "SERVO4_MAX": 1900,
    "SERVO4_REVERSED": 0, "SERVO1_FUNCTION": 4,
}  # fmt: skip
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


def matrices(of: Mapping[str, float], airspeed_m_s: float) -> tuple[Floats, Floats]:
    """Return A (4, 4) and B (4, 2)."""
    A = np.array([
        [of["Y_beta"], 0.0, -1.0, GRAVITY / airspeed_m_s],
        [of["L_beta"], of["L_p"], of["L_r"], 0.0],
        [of["N_beta"], of["N_p"], of["N_r"], 0.0],
        [0.0, 1.0, 0.0, 0.0],
    ])  # fmt: skip
    B = np.array([[0.0, 0.0], [of["L_delta_a"], of["L_delta_r"]],
                  [of["N_delta_a"], of["N_delta_r"]], [0.0, 0.0]])  # fmt: skip
    return A, B


def dutch_roll(of: Mapping[str, float] = LIGHT, airspeed_m_s: float = 50.0) -> tuple[float, float]:
    """Return wn in rad/s and zeta."""
    poles = np.linalg.eigvals(matrices(of, airspeed_m_s)[0])
    pole = poles[poles.imag > 1e-6][0]
    return float(abs(pole)), float(-pole.real / abs(pole))


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
    rate_hz: int = 50,
) -> bytes:
    """Return the log, servos at 50 Hz. ``hold`` are the gains of roll and p in FBWA.

    In ``manual`` nothing but the sticks moves the surfaces. Gusts have the sideslip ``gust_rad``.
    """
    rng, made = np.random.default_rng(seed), FlightLog()
    mode = mavlink.MAVLink_heartbeat_message(1, 3, ARMED, 0 if manual else 5, 4, 3)
    made.add(START_S - BEFORE_S, mode)
    for name, value in PARAMETERS.items():
        made.parameter(START_S - BEFORE_S, name, value)
    step, kick = _step(legs[0], False, lag_s, gust_rad)
    moves = [_moves(leg, rudder, aileron) for leg in legs]
    before, per_leg = round(BEFORE_S / TICK_S), round(LEG_S / TICK_S)
    frames: list[list[bytes]] = []
    x = np.zeros(9)
    for k in range(before + per_leg * len(legs)):
        number, tick = divmod(k - before, per_leg) if k >= before else (0, -1)
        leg, wished = legs[number], moves[number][tick]
        if tick in (0, round(leg.at * per_leg)):
            step, kick = _step(leg, tick > 0, lag_s, gust_rad)
        t = START_S - BEFORE_S + TICK_S * k
        heard = x[1:4] + np.array([GYRO_RAD_S, GYRO_RAD_S, ROLL_RAD]) * rng.normal(size=3)
        held = 0.0 if manual else hold[0] * heard[2] + hold[1] * heard[0]
        pwm = [round(1500 + TRAVEL_US * each) for each in (wished[0] - held, wished[1])]
        x[7:] = (np.array(pwm) - 1500) / TRAVEL_US
        if k % 25 == 0:
            told = leg.airspeed_m_s if leg.told_m_s is None else leg.told_m_s
            made.add(t, mode)
            if told == told:
                made.add(t, mavlink.MAVLink_vfr_hud_message(told, told + 3.0, 0, 50, 0.0, 0.0))
        p, r, roll = heard
        if k % (50 // rate_hz) == 0:
            made.add(t, mavlink.MAVLink_attitude_message(round(1000 * t), roll, 0, 0, p, 0, r))
        made.servos(t + 0.004, [pwm[0], 1500, 1500, pwm[1]])
        if len(made.data) > 100_000:  # to append to a long string would take long
            frames.append([made.data])
            made.data = b""
        x = step @ x
        x[4] += kick * rng.normal()
    return b"".join([data for [data] in frames] + [made.data])


def _step(leg: Leg, is_later: bool, lag_s: float, gust_rad: float) -> tuple[Floats, float]:
    """Return the matrix of a step (states, gust, servos, commands) and a gust's change."""
    of = leg.later if is_later and leg.later is not None else leg.aircraft
    A, B = matrices(of, leg.airspeed_m_s)
    whole, rate = np.zeros((9, 9)), 0.3
    whole[:4, :4], whole[:4, 4], whole[:4, 5:7] = A, A[:, 0], B
    whole[4, 4] = -rate
    whole[[5, 6], [5, 6]], whole[[5, 6], [7, 8]] = -1.0 / lag_s, 1.0 / lag_s
    return expm(whole * TICK_S), float(np.sqrt(-np.expm1(-2.0 * rate * TICK_S)) * gust_rad)


def _moves(leg: Leg, rudder: float, aileron: float) -> Floats:
    """Return what the pilot wants of aileron and rudder (n, 2), at last nothing."""
    unit_s = 2.0 / dutch_roll(leg.aircraft, leg.airspeed_m_s)[0]
    at_s, found = 0.0, np.zeros((round(LEG_S / TICK_S), 2))
    for own, side, length in SHAPE:
        first, stop = (round(t / TICK_S) for t in (at_s, at_s + length * unit_s))
        found[first:stop] = own * aileron, side * rudder
        at_s += length * unit_s
    return found
