"""One known flight to be logged in several ways: a Dutch roll answering a rudder that jumps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import cont2discrete

STEP_S = 0.02
START_S = 20.0
WN, ZETA, GAIN = 4.0, 0.3, 0.8
TRAVEL = (1100, 1500, 1900)


@dataclass(frozen=True)
class Flight:
    """What was flown at the times ``t`` (n,) in s: rates and angles in rad, rudder in us."""

    t: np.ndarray
    roll: np.ndarray
    pitch: np.ndarray
    yaw: np.ndarray
    rates: np.ndarray
    pwm: np.ndarray


def flown(seconds: float = 60.0, seed: int = 3) -> Flight:
    """Return a flight at 50 Hz; single precision, as logs keep it."""
    rng = np.random.default_rng(seed)
    n = round(seconds / STEP_S)
    rudder = np.repeat(rng.choice([-0.3, 0.0, 0.3], n // 20 + 1), 20)[:n]
    A = np.array([[0.0, 1.0], [-(WN**2), -2.0 * ZETA * WN]])
    B = np.array([[0.0], [GAIN * WN**2]])
    Ad, Bd, *_ = cont2discrete((A, B, np.eye(2), np.zeros((2, 1))), STEP_S)
    x, r = np.zeros(2), np.zeros(n)
    for k in range(n):
        r[k] = x[0]
        x = Ad @ x + Bd[:, 0] * rudder[k]
    t = START_S + STEP_S * np.arange(n)
    roll, pitch = 0.1 * np.sin(0.5 * t), 0.05 * np.cos(0.3 * t)
    yaw = (3.0 + 0.1 * t + np.cumsum(r) * STEP_S + np.pi) % (2.0 * np.pi) - np.pi
    p, q = 0.05 * np.cos(0.5 * t), -0.015 * np.sin(0.3 * t)
    rates = np.column_stack([p, q, r]).astype(np.float32)
    pwm = np.rint(TRAVEL[1] + 400.0 * rudder).astype(int)
    return Flight(t, roll, pitch, yaw, rates, pwm)
