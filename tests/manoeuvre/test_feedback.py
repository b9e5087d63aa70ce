"""How much of the rudder feeds back the yaw rate: found between a pilot's movements."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.signal import cont2discrete

from yawid.blocks import Floats
from yawid.manoeuvre.feedback import rate_feedback

WN, ZETA, TS, FINE = 4.0, 0.2, 0.05, 0.005
"""A plant r / rudder = WN^2 / (s^2 + 2 ZETA WN s + WN^2), on a grid of TS s, computed in FINE s."""


def flown(gain: float, pilot: Floats, noise: float = 0.0) -> tuple[Floats, Floats, Floats]:
    """Return rudder, yaw rate r and aileron; rudder = pilot - gain * r, ``pilot`` each FINE s."""
    system = np.array([[0.0, 1.0], [-(WN**2), -2.0 * ZETA * WN]]), np.array([[0.0], [WN**2]])
    a, b, *_ = cont2discrete((*system, np.eye(2), np.zeros((2, 1))), FINE)
    x, rudder, r = np.zeros(2), np.zeros(len(pilot)), np.zeros(len(pilot))
    rng = np.random.default_rng(1)
    for k, moved in enumerate(pilot):
        r[k] = x[0]
        rudder[k] = moved - gain * (x[0] + noise * rng.normal())
        x = a @ x + b[:, 0] * rudder[k]
    every = round(TS / FINE)
    u, y = rudder.reshape(-1, every).mean(axis=1), r[::every]
    y = y + noise * rng.normal(size=len(y))
    return u, y, np.full(len(y), np.nan)


def doublets(count: int = 10) -> Floats:
    each = np.concatenate([np.full(130, 0.2), np.full(130, -0.2), np.zeros(740)])
    return np.tile(each, count)


def sweep() -> Floats:
    t = FINE * np.arange(8000)
    return 0.2 * np.sin((0.3 + 0.2 * t) * t)


@pytest.mark.parametrize("noise", [0.0, 0.002])
@pytest.mark.parametrize("gain", [0.1, 0.4, 1.5])
def test_the_gain_of_a_damper_is_found_between_the_movements(gain: float, noise: float) -> None:
    found = rate_feedback(*flown(gain, doublets(), noise), WN, TS)

    assert math.isclose(found.gain, -gain, rel_tol=0.15)
    # |r / rudder| at WN is 1 / (2 ZETA), less on both sides of it.
    assert 0.3 * gain / (2.0 * ZETA) < found.share < 1.05 * gain / (2.0 * ZETA)


@pytest.mark.parametrize("pilot", [doublets(), sweep()], ids=["doublets", "sweep"])
def test_a_pilots_rudder_is_no_feedback(pilot: Floats) -> None:
    found = rate_feedback(*flown(0.0, pilot, 0.002), WN, TS)

    assert found is None or found.share < 0.1
