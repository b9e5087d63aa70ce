"""Motions of a linear aircraft with known derivatives, by their own equations of motion."""

from __future__ import annotations

from typing import Any

import numpy as np
from linear_flights import Floats, airframe
from scipy.linalg import expm

from yawid.lateral.motion import COMMAND_STEP_S, Motion

AIRSPEED_M_S = 50.0
BETA, P, R, ROLL, B, W = range(6)
DERIVATIVES = {
    "Y_beta": -0.25, "L_beta": -9.0, "L_p": -4.0, "L_r": 1.2, "L_delta_a": 8.0, "L_delta_r": -0.5,
    "N_beta": 4.0, "N_p": -0.15, "N_r": -0.6, "N_delta_a": 0.1, "N_delta_r": 1.5,
    "Y_delta_r": -0.05,
}  # fmt: skip
"""Of a light aircraft at 50 m/s, as the answers name them."""
GUST_RATE, ROLL_GUST_RATE = 0.3, 4.0
GYRO, ANGLE = 0.003, 0.001
SHAPE = ((1.0, 0), (1.2, 1), (0.8, -1), (0.4, 1), (0.4, -1), (8.2, 0))


def moves(n: int, start_s: float, amplitude: float, ramp_s: float = 0.08) -> Floats:
    """Return a 3-2-1-1 (n,) on the commands' grid, again and again, on lines between its points."""
    times, values, at = [-10.0], [0.0], start_s
    while at < n * COMMAND_STEP_S:
        for length_s, value in SHAPE:
            times += [at + ramp_s, at + length_s]
            values += [amplitude * value] * 2
            at += length_s
    return np.interp(np.arange(n) * COMMAND_STEP_S, times, values)


def flown(
    seed: int | None = None,
    *,
    seconds: float = 30.0,
    rate_hz: float = 25.0,
    lag_s: float = 0.0,
    gust: float = 0.0,
    amplitude: float = 0.15,
    derivatives: dict[str, float] = DERIVATIVES,
    hold: tuple[float, float] = (0.0, 0.0),
    aileron: float = 0.1,
    roll_lag_s: float = 0.0,
    damper: float = 0.0,
    pitch: float = 0.0,
    ramp_s: float = 0.08,
    stall_rad: float = np.inf,
    limited: tuple[float, float] = (0.0, 0.0),
    **changed: Any,
) -> Motion:
    """Return a motion; without a seed it has no noise. ``hold`` are the roll hold's two gains.

    The state is exact for commands on lines between the points of their grid. Gusts have the
    sideslip ``gust`` in rad. The roll hold hears what is measured, the roll angle behind a lag,
    and so does a yaw damper with the gain ``damper``. With a ``pitch`` it climbs as steeply. The
    fin's sideslip a is stall_rad tanh(a / stall_rad), and a yaw damper that is in no record moves
    the rudder by ``limited``, which are its gain and the most that it moves.
    """
    lead, every = round(1.0 / COMMAND_STEP_S), round(1.0 / rate_hz / COMMAND_STEP_S)
    n = lead + round(seconds / COMMAND_STEP_S) + 1
    rudder, own = moves(n, 1.52, amplitude, ramp_s), moves(n, 4.52, aileron)
    A, controls = airframe(derivatives, pitch)
    whole = np.zeros((8, 10))  # beta, p, r, roll, gusts, aileron, rudder; then the commands
    whole[:4, :4], whole[:4, 6:8] = A, controls
    whole[:3, B], whole[P, W] = A[:3, BETA], 1.0
    whole[B, B], whole[W, W] = -GUST_RATE, -ROLL_GUST_RATE
    fast = max(lag_s, 1e-12)
    whole[[6, 7], [6, 7]], whole[[6, 7], [8, 9]] = -1.0 / fast, 1.0 / fast
    if lag_s == 0.0:
        whole[:4, 8:10], whole[:4, 6:8], whole[6:] = controls, 0.0, 0.0
    # the commands and their slopes are states of a larger system, whose exponential is exact
    larger = np.zeros((12, 12))
    larger[:8, :10], larger[8, 10], larger[9, 11] = whole, 1.0, 1.0
    step = expm(larger * COMMAND_STEP_S)[:8]
    rng = np.random.default_rng(seed)
    noisy = 0.0 if seed is None else 1.0
    sizes = noisy * np.array([GYRO, GYRO, ANGLE])
    kicks = np.sqrt(2.0 * COMMAND_STEP_S * np.array([GUST_RATE, ROLL_GUST_RATE]))
    kicks = kicks * gust * np.array([1.0, 5.0])
    x, commands, seen = np.zeros(8), np.stack([own, rudder]), []
    held_roll, follows = 0.0, -np.expm1(-COMMAND_STEP_S / max(roll_lag_s, 1e-12))
    for k in range(n):
        heard = x[[P, R, ROLL]] + sizes * rng.normal(size=3)
        if any(hold):
            held_roll += follows * (heard[2] - held_roll)
            commands[0, k] = own[k] - hold[0] * held_roll - hold[1] * heard[0]
        commands[1, k] = rudder[k] - damper * heard[1]
        if k >= lead and (k - lead) % every == 0:
            seen.append(heard)
        now, after = commands[:, k], commands[:, min(k + 1, n - 1)]
        held = any(hold) or damper
        slope = np.zeros(2) if held else (after - now) / COMMAND_STEP_S
        x = step @ np.concatenate([x, now, slope])
        x[[B, W]] += kicks * rng.normal(size=2)
        a, damps = x[BETA] + x[B], min(max(limited[0] * x[R], -limited[1]), limited[1])
        if stall_rad < np.inf:
            x[:3] += COMMAND_STEP_S * A[:3, BETA] * (stall_rad * np.tanh(a / stall_rad) - a)
        x[:4] -= COMMAND_STEP_S * controls[:, 1] * damps
    p, r, roll = np.array(seen).T
    given: dict[str, Any] = {
        "sample_time_s": 1.0 / rate_hz, "p": p, "r": r, "roll": roll,
        "pitch": np.full(len(p), pitch), "climb": pitch, "q": np.zeros(len(p)),
        "commands_start_s": -1.0,
        "rudder": commands[1], "aileron": commands[0], "airspeed_m_s": AIRSPEED_M_S,
    }  # fmt: skip
    return Motion(**(given | changed))
