"""Flights of linear aircraft that only a roll hold and gusts roll: tlogs, and the truth of each.

An aircraft is drawn by a seed: x' = A x + B u of [beta, p, r, roll] and of [aileron, rudder] behind
servos of first order. The autopilot hears p and roll as they are logged, noise and all, and its
command stays until the next of them.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from flightlog import FlightLog
from numpy.typing import NDArray
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from scipy.linalg import expm

Floats = NDArray[np.float64]
STEP_S, START_S = 0.005, 10.0
GYRO_RAD_S, ROLL_RAD, TRAVEL_US = 0.003, 0.001, 400
GRAVITY = 9.80665


class Truth(NamedTuple):
    """Of a flight: the Dutch roll, the pole of the roll mode and L_p in 1/s, and how it flew."""

    wn_rad_s: float
    zeta: float
    roll_pole: float
    L_p: float
    lag_s: float
    rate_hz: int
    gust_rad: float
    A: Floats
    B: Floats
    hold: Floats
    airspeed_m_s: float


def drawn(seed: int) -> Truth:
    """Return the aircraft, its roll hold (of [beta, p, r, roll]) and servo of a seed."""
    rng = np.random.default_rng(seed)
    while True:
        w = np.exp(rng.uniform(0.0, np.log(6.0)))
        V, lag_s = 60.0 * w**-0.6, rng.uniform(0.02, 0.12)
        roll = -w * rng.uniform(0.8, 3.0)
        L_da, N_dr = abs(roll) * w * rng.uniform(1.0, 2.5), w**2 * rng.uniform(0.3, 0.7)
        A = np.array([
            [-w * rng.uniform(0.03, 0.2), rng.uniform(-0.02, 0.08), -1.0, GRAVITY / V],
            [-(w**2) * rng.uniform(0.3, 2.5), roll, w * rng.uniform(0.1, 0.8), 0.0],
            [w**2, w * rng.uniform(-0.15, 0.03), -w * rng.uniform(0.03, 0.6), 0.0],
            [0.0, 1.0, 0.0, 0.0],
        ])  # fmt: skip
        A[3, 2] = np.tan(A[0, 1])
        B = np.array([
            [0.0, -N_dr / w * rng.uniform(0.0, 0.03)], [L_da, -N_dr * rng.uniform(-0.1, 0.4)],
            [-L_da * rng.uniform(-0.05, 0.1), N_dr], [0.0, 0.0],
        ])  # fmt: skip
        gains = np.array([0.0, abs(roll) * rng.uniform(0.1, 0.8), 0.0, 0.0]) / L_da
        gains[3] = abs(roll) * w * rng.uniform(0.2, 0.8) / L_da
        poles = np.linalg.eigvals(A)
        pair, real = poles[poles.imag > 1e-6], np.sort(poles.real[np.abs(poles.imag) <= 1e-6])
        if len(pair) != 1 or not 1.0 <= (wn := float(abs(pair[0]))) <= 6.0:
            continue
        rate_hz = 25 if max(wn, -real[0]) < 5.0 and rng.random() < 0.5 else 50
        zeta, late_s = float(-pair[0].real / wn), lag_s + 0.5 / rate_hz
        held = np.block([[A, B[:, :1]], [-gains / late_s, -1.0 / late_s]])
        slowest = np.linalg.eigvals(held).real.max()
        if (
            0.05 <= zeta <= 0.5
            and abs(real[1]) < 0.2
            and -12.0 < real[0] < -1.0
            and slowest < -0.02
        ):
            gust = float(rng.choice([0.0, 0.005, 0.01]))
            return Truth(wn, zeta, float(real[0]), roll, lag_s, rate_hz, gust, A, B, gains, V)


def flown(seed: int) -> tuple[bytes, Truth]:
    """Return the tlog of a flight with two manoeuvres of the rudder in FBWA, and its truth.

    What a bank adds to the linear motion, the sine of gravity and the yaw in the bank, is in it.
    """
    of = drawn(seed)
    rng = np.random.default_rng([seed, 1])
    whole = np.zeros((9, 9))  # the aircraft's states, gust, the surfaces, their commands
    whole[:4, :4], whole[:4, 4], whole[:4, 5:7] = of.A, of.A[:, 0], of.B
    gust_rate = rng.uniform(0.1, 0.5)
    whole[4, 4] = -gust_rate
    whole[[5, 6], [5, 6]], whole[[5, 6], [7, 8]] = -1.0 / of.lag_s, 1.0 / of.lag_s
    step, kick = expm(whole * STEP_S), np.sqrt(-np.expm1(-2.0 * gust_rate * STEP_S)) * of.gust_rad
    x = np.zeros(9)
    x[4] = of.gust_rad * rng.normal()
    rudder = _rudder(of, rng)
    offset_s = rng.uniform(0.0, 0.02)
    made = FlightLog()
    mode = mavlink.MAVLink_heartbeat_message(1, 3, 0, 5, 4, 3)
    made.add(START_S, mode)
    for name, value in (("SERVO4_FUNCTION", 21.0), ("SERVO1_FUNCTION", 4.0)):
        made.parameter(START_S, name, value)
    for k in range(len(rudder)):
        t = START_S + k / of.rate_hz
        heard = x[1:4] + np.array([GYRO_RAD_S, GYRO_RAD_S, ROLL_RAD]) * rng.normal(size=3)
        aileron = -of.hold @ np.array([0.0, heard[0], 0.0, heard[2]])
        pwm = [round(1500 + TRAVEL_US * each) for each in (aileron, rudder[k])]
        x[7:] = (np.array(pwm) - 1500) / TRAVEL_US
        if k % of.rate_hz == 0:
            made.add(t, mode)
            hud = (of.airspeed_m_s, of.airspeed_m_s, 0, 50, 0.0, 0.0)
            made.add(t, mavlink.MAVLink_vfr_hud_message(*hud))
        p, r, roll = heard
        made.add(t, mavlink.MAVLink_attitude_message(round(1000 * t), roll, of.A[0, 1], 0, p, 0, r))
        made.servos(t + offset_s, [pwm[0], 1500, 1500, pwm[1]])
        for _ in range(round(1.0 / of.rate_hz / STEP_S)):
            x = step @ x
            x[4] += kick * rng.normal()
            bank = x[3]
            x[0] += STEP_S * GRAVITY / of.airspeed_m_s * (np.sin(bank) - bank)
            x[3] += STEP_S * of.A[3, 2] * x[2] * (np.cos(bank) - 1.0)
    return made.data, of


def _rudder(of: Truth, rng: Any) -> Floats:
    """Return the rudder's command (n,) about trim: a 3-2-1-1, rest, two doublets, rest."""
    period_s, size = 2.0 * np.pi / of.wn_rad_s, rng.uniform(0.15, 0.3)
    pieces, unit_s = [(11.0, 0.0)], 0.3 * period_s
    shapes = [[(3, 1), (2, -1), (1, 1), (1, -1)], [(2, 1), (2, -1), (6, 0), (1, 1), (1, -1)]]
    for shape in shapes:
        pieces += [(length * unit_s, side * size) for length, side in shape]
        pieces.append((7.0 + 3.0 * period_s, 0.0))
    return np.concatenate([np.full(round(each * of.rate_hz), value) for each, value in pieces])
