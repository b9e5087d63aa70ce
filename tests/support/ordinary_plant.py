"""Ordinary flights of a linear aircraft with known derivatives, simulated exactly, as blocks.

Its gusts, noise, roll law and turns are those of the model's equations, and the aileron is held
from one sample to the next.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from flightlog import FlightLog, beat, hud, told
from linear_flights import airframe, modes
from numpy.typing import NDArray
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from scipy.linalg import expm

from yawid.blocks import MotionBlock, SampleBlock, StampedRows

Floats = NDArray[np.float64]
AIRSPEED_M_S = 50.0
DERIVATIVES = {
    "Y_beta": -0.25, "L_beta": -9.0, "L_p": -4.0, "L_r": 1.2, "L_delta_a": 8.0, "L_delta_r": 0.0,
    "N_beta": 4.0, "N_p": -0.15, "N_r": -0.6, "N_delta_a": 0.1, "N_delta_r": 0.0,
}  # fmt: skip
LAW = 1.0, 0.3
PARAMETERS = {
    f"SERVO{n}_{name}": value
    for n, function in ((1, 4.0), (4, 21.0))
    for name, value in {
        "FUNCTION": function, "MIN": 1100.0, "TRIM": 1500.0, "MAX": 1900.0, "REVERSED": 0.0
    }.items()
}  # fmt: skip


def truth(derivatives: dict[str, float] = DERIVATIVES) -> tuple[float, float]:
    """Return wn and zeta of the bare airframe."""
    return modes(airframe(derivatives, 0.0, AIRSPEED_M_S)[0])[:2]


def flown(
    seed: int,
    *,
    seconds: float = 600.0,
    gust: float = 0.01,
    turns: bool = True,
    rate_hz: float = 25.0,
    derivatives: dict[str, float] = DERIVATIVES,
    frozen: float = 0.0,
    span_s: float = 0.0,
    damper: float = 0.0,
    noise: float = 0.002,
    law: tuple[float, float] = LAW,
    integral: float = 0.0,
) -> Floats:
    """Return t, p, r, roll, aileron and rudder (n, 6) of a flight.

    ``gust`` is the sideslip of the lateral gusts in rad; ``frozen`` of their slope is a yaw rate,
    behind a lag of ``span_s``. ``integral`` is the roll hold's, of the bank missed. The turns are
    small, so that the motion stays linear.
    """
    rng, step_s = np.random.default_rng(seed), 1.0 / rate_hz
    A, B = airframe(derivatives, 0.0, AIRSPEED_M_S)
    of, rate, roll_rate = derivatives, 0.4, 4.0
    whole = np.zeros((9, 9))  # beta, p, r, roll, b, w, the two commands, and b behind the lag
    whole[:4, :4], whole[:4, 6:8] = A, B
    whole[2, 7] = 2.0  # of the rudder
    b_drive = np.array([0.0, of["L_r"], of["N_r"], 0.0]) * frozen
    whole[:4, 4] = A[:, 0] - rate * b_drive
    if span_s:
        whole[8, 4], whole[8, 8] = 1.0 / span_s, -1.0 / span_s
        whole[:4, 4], whole[:4, 8] = A[:, 0] + b_drive / span_s, -b_drive / span_s
        b_drive = np.zeros(4)
    whole[:4, 5] = [0.0, of["L_p"], of["N_p"], 0.0]
    whole[4, 4], whole[5, 5] = -rate, -roll_rate
    Q = np.zeros((9, 9))
    kick = np.concatenate([b_drive, [1.0]]) * math.sqrt(2.0 * rate) * gust
    Q[:5, :5] = np.outer(kick, kick)
    Q[5, 5] = (roll_rate * gust) ** 2
    both = expm(np.block([[-whole, Q], [np.zeros((9, 9)), whole.T]]) * step_s)
    Phi = both[9:, 9:].T
    values, vectors = np.linalg.eigh(Phi @ both[:9, 9:])
    kicks = vectors * np.sqrt(np.maximum(values, 0.0))
    n = round(seconds / step_s)
    asked = _asked(rng, n, step_s) if turns else np.zeros(n)
    x, found = np.zeros(9), np.zeros((n, 6))
    white = rng.normal(size=(n, 9))
    errors = rng.normal(size=(n, 3)) * [noise, noise, 0.3 * noise]
    missed = 0.0
    for k in range(n):
        p, r, roll = x[1:4] + errors[k]
        missed += (roll - asked[k]) * step_s
        x[6] = -law[0] * (roll - asked[k]) - law[1] * p - integral * missed
        x[7] = -damper * r
        found[k] = k * step_s, p, r, roll, x[6], x[7]
        x = Phi @ x + kicks @ white[k]
    return found


def _asked(rng: np.random.Generator, n: int, step_s: float) -> Floats:
    """Return the bank asked for in rad (n,), on ramps."""
    lengths = np.round(rng.uniform(8.0, 30.0, size=n // 100) / step_s).astype(int)
    wanted = np.repeat(rng.uniform(-0.25, 0.25, size=n // 100), lengths)[:n]
    most = 0.3 * step_s
    asked = np.zeros(n)
    for k in range(1, n):
        asked[k] = asked[k - 1] + min(max(wanted[k] - asked[k - 1], -most), most)
    return asked


def blocks(
    flight: Floats, rate_hz: float = 25.0, **columns: Any
) -> tuple[MotionBlock, SampleBlock]:
    """Return the motion and the samples of a flight, as the channels give them."""
    t_us = np.round(1e6 * (flight[:, 0] + 30.0)).astype(np.int64)
    n, (p, r, roll, aileron, rudder) = len(flight), flight[:, 1:].T
    zero, none = np.zeros(n), np.zeros(n, np.int64)
    attitude = np.column_stack([roll, zero, p, zero, r])
    held = np.column_stack([rudder, aileron, zero, zero + 1.0])
    later_us = t_us + round(0.5e6 / rate_hz)  # a line between held values is half a step late
    motion = MotionBlock(
        StampedRows(t_us, 1000 * t_us, attitude), StampedRows(later_us, 1000 * later_us, held),
        StampedRows(t_us[:0], t_us[:0], np.zeros((0, 2))),
    )  # fmt: skip
    k = np.arange(n) + round(30.0 * rate_hz)
    samples = SampleBlock(
        1.0 / rate_hz, k, t_us, 1000 * t_us, t_us, rudder[:, None], r, zero, roll, zero,
        zero + AIRSPEED_M_S, none, none, none, aileron, zero, zero, zero, zero, zero, zero + 1.0,
    )  # fmt: skip
    return motion, samples


def as_tlog(flight: Floats, later_s: float = 0.0) -> bytes:
    """Return the tlog of a flight, whose servo messages come between the attitudes.

    It begins ``later_s`` after the others.
    """
    log = FlightLog()
    for name, value in PARAMETERS.items():
        log.add(later_s + 29.0, told(name, value, len(PARAMETERS)))
    for k, (t, p, r, roll, aileron, rudder) in enumerate(flight.tolist()):
        t += 30.0  # a vehicle is on for a while before it flies
        at_s, ms, us = later_s + t, round(1e3 * t), round(1e6 * t)
        if k % 25 == 0:
            log.add(at_s, beat(base_mode=0x80, mode=5))  # in FBWA, armed
        if k % 5 == 0:
            log.add(at_s, hud(AIRSPEED_M_S, 47.0, 0.0))
        log.add(at_s, mavlink.MAVLink_attitude_message(ms, roll, 0.0, 0.0, p, 0.0, r))
        pwm = [round(1500.0 + 400.0 * aileron), 1500, 1500, round(1500.0 + 400.0 * rudder)]
        log.add(at_s + 0.001, mavlink.MAVLink_servo_output_raw_message(us, 0, *pwm, 0, 0, 0, 0))
    return log.data
