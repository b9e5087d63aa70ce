"""Flights of linear aircraft: x' = A x + B u of [beta, p, r, roll] and of [aileron, rudder].

The surfaces are in half travels, behind servos of first order. The autopilot hears p and roll as
they are logged, noise and all, and its command stays until the next of them. ``flown`` makes tlogs
of aircraft that are drawn by a seed, and that only a roll hold and gusts roll.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
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
SIZES = np.array([GYRO_RAD_S, GYRO_RAD_S, ROLL_RAD])
ARMED, FBWA, PARAMETERS = 128, 5, {
    "SERVO4_FUNCTION": 21, "SERVO4_MIN": 1100, "SERVO4_TRIM": 1500, "SERVO4_MAX": 1900,
    "SERVO4_REVERSED": 0, "SERVO1_FUNCTION": 4,
}  # fmt: skip
Plant = tuple[Floats, float]
"""The matrix of a step (9, 9), and a gust's standard deviation of change in it."""


def airframe(
    of: Mapping[str, float], pitch: float = 0.0, airspeed_m_s: float = 50.0
) -> tuple[Floats, Floats]:
    """Return A (4, 4) and B (4, 2) of the derivatives; alpha is 0."""
    A = np.array([
        [of["Y_beta"], 0.0, -1.0, GRAVITY / airspeed_m_s * np.cos(pitch)],
        [of["L_beta"], of["L_p"], of["L_r"], 0.0],
        [of["N_beta"], of["N_p"], of["N_r"], 0.0],
        [0.0, 1.0, np.tan(pitch), 0.0],
    ])  # fmt: skip
    B = np.array([
        [0.0, of.get("Y_delta_r", 0.0)], [of["L_delta_a"], of["L_delta_r"]],
        [of["N_delta_a"], of["N_delta_r"]], [0.0, 0.0],
    ])  # fmt: skip
    return A, B


def modes(A: Floats) -> tuple[float, float, float]:
    """Return wn, zeta and the time constant of the roll mode of A (4, 4)."""
    poles = np.linalg.eigvals(A)
    pair = poles[poles.imag > 1e-6][0]
    return float(abs(pair)), float(-pair.real / abs(pair)), float(-1.0 / poles.real.min())


def plant(
    A: Floats, B: Floats, lag_s: float, gust_rate: float, gust_rad: float, step_s: float
) -> Plant:
    """Return the exact step of states (4), gust, surfaces (2) and held commands (2)."""
    whole = np.zeros((9, 9))
    whole[:4, :4], whole[:4, 4], whole[:4, 5:7] = A, A[:, 0], B
    whole[4, 4] = -gust_rate
    whole[[5, 6], [5, 6]], whole[[5, 6], [7, 8]] = -1.0 / lag_s, 1.0 / lag_s
    kick = np.sqrt(-np.expm1(-2.0 * gust_rate * step_s)) * gust_rad
    return expm(whole * step_s), float(kick)


def tlog(
    rng: np.random.Generator,
    wished: Floats,
    plants: Sequence[Plant],
    airspeeds_m_s: Sequence[float],
    *,
    hold: tuple[float, float] = (0.0, 0.0),
    mode: int = FBWA,
    gust_rad: float = 0.0,
    pitch: float = 0.0,
    tick_s: float = 0.02,
    steps: int = 1,
    every: int = 1,
    servos_s: float = 0.004,
    bend: Callable[[Floats], None] | None = None,
) -> bytes:
    """Return the log of a flight of which each tick has a command, a plant and an airspeed.

    ``wished`` (n, 2) is what the pilot wants of aileron and rudder, ``hold`` are the roll hold's
    gains of roll and p. ``bend`` changes the states after each of a tick's ``steps``. ATTITUDE is
    sent every so many ticks, and the servos ``servos_s`` after each; an airspeed of NaN is not.
    """
    made = FlightLog()
    heartbeat = mavlink.MAVLink_heartbeat_message(1, 3, ARMED, mode, 4, 3)
    made.add(START_S, heartbeat)
    for name, value in PARAMETERS.items():
        made.parameter(START_S, name, value)
    x = np.zeros(9)
    x[4] = gust_rad
    for k, ((aileron, rudder), (step, kick)) in enumerate(zip(wished, plants, strict=True)):
        t, said = START_S + tick_s * k, airspeeds_m_s[k]
        p, r, roll = x[1:4] + SIZES * rng.normal(size=3)
        own = aileron - hold[0] * roll - hold[1] * p
        pwm = [round(1500 + TRAVEL_US * each) for each in (own, rudder)]
        if k % round(0.5 / tick_s) == 0:
            made.add(t, heartbeat)
            if said == said:
                made.add(t, mavlink.MAVLink_vfr_hud_message(said, said + 3.0, 0, 50, 0.0, 0.0))
        if k % every == 0:
            attitude = (round(1000 * t), roll, pitch, 0.0, p, 0.0, r)
            made.add(t, mavlink.MAVLink_attitude_message(*attitude))
        made.servos(t + servos_s, [pwm[0], 1500, 1500, pwm[1]])
        x[7:] = (np.array(pwm) - 1500) / TRAVEL_US
        for _ in range(steps):
            x = step @ x
            x[4] += kick * rng.normal()
            if bend is not None:
                bend(x)
    return made.data


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
    gust_rate = rng.uniform(0.1, 0.5)
    gust_rad = of.gust_rad * rng.normal()
    rudder = _rudder(of, rng)
    offset_s = rng.uniform(0.0, 0.02)

    def bend(x: Floats) -> None:
        x[0] += STEP_S * GRAVITY / of.airspeed_m_s * (np.sin(x[3]) - x[3])
        x[3] += STEP_S * of.A[3, 2] * x[2] * (np.cos(x[3]) - 1.0)

    its = plant(of.A, of.B, of.lag_s, gust_rate, of.gust_rad, STEP_S)
    n, hold = len(rudder), (float(of.hold[3]), float(of.hold[1]))
    data = tlog(
        rng, np.stack([np.zeros(n), rudder], axis=1), [its] * n, [of.airspeed_m_s] * n,
        hold=hold, gust_rad=gust_rad, pitch=float(of.A[0, 1]), tick_s=1.0 / of.rate_hz,
        steps=round(1.0 / of.rate_hz / STEP_S), servos_s=offset_s, bend=bend,
    )  # fmt: skip
    return data, of


def _rudder(of: Truth, rng: Any) -> Floats:
    """Return the rudder's command (n,) about trim: a 3-2-1-1, rest, two doublets, rest."""
    period_s, size = 2.0 * np.pi / of.wn_rad_s, rng.uniform(0.15, 0.3)
    pieces, unit_s = [(11.0, 0.0)], 0.3 * period_s
    shapes = [[(3, 1), (2, -1), (1, 1), (1, -1)], [(2, 1), (2, -1), (6, 0), (1, 1), (1, -1)]]
    for shape in shapes:
        pieces += [(length * unit_s, side * size) for length, side in shape]
        pieces.append((7.0 + 3.0 * period_s, 0.0))
    return np.concatenate([np.full(round(each * of.rate_hz), value) for each, value in pieces])
