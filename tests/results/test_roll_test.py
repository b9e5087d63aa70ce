"""The residuals know of a roll that has a part in the yaw, and of no other."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from yawid.config.estimator import ArmaxOrders, EstimatorConfig
from yawid.estimation.armax import RecursiveArmax
from yawid.estimation.bank import History
from yawid.plant.lateral import INPUTS, OUTPUTS, lateral_motion
from yawid.plant.simulate import REFERENCE
from yawid.results.roll_test import roll_p

TS, N = 0.1, 1200
CONFIG = EstimatorConfig(orders=ArmaxOrders(na=3, nb=3, nc=2, nk=1), sample_time_s=TS, method="rml")
BANKED_BY_GUSTS = replace(REFERENCE, a_mx_beta=0.0, a_mx_omega_y=0.0)


def flown(seed: int, gusts: float) -> History:
    """Eq. 21 under rudder and gusts that bank the aircraft, so that the bank turns it."""
    rng = np.random.default_rng(seed)
    u = np.zeros((N, len(INPUTS)))
    u[:, INPUTS.index("-delta_h")] = np.repeat(rng.choice([-0.1, 0.1], N // 5), 5)
    u[:, INPUTS.index("-delta_b")] = gusts * np.repeat(rng.standard_normal(N // 5), 5)
    out = lateral_motion(BANKED_BY_GUSTS).simulate(u, TS)
    y, roll = (out[:, OUTPUTS.index(name)] for name in ("psi_rate", "gamma"))
    y = y + 0.03 * y.std() * rng.standard_normal(N)
    if gusts == 0.0:  # a roll that has no part in the yaw
        roll = np.cumsum(0.01 * rng.standard_normal(N))
    rudder = u[:, [INPUTS.index("-delta_h")]]
    return History(rudder, y, roll, np.zeros(N), np.full(N, 50.0), *np.full((2, N), np.nan), {})


def p_of(history: History, config: EstimatorConfig = CONFIG) -> float:
    armax = RecursiveArmax(config)
    armax.run(history.u, history.y)
    return roll_p(armax.theta, config, history)


def test_a_roll_that_turns_the_aircraft_is_found_in_the_residuals():
    assert p_of(flown(1, gusts=0.02)) < 1e-6
    assert p_of(flown(1, gusts=0.02), replace(CONFIG, method="els")) < 1e-6


def test_a_roll_without_a_part_in_the_yaw_is_not():
    found = np.array([p_of(flown(seed, gusts=0.0)) for seed in range(60)])

    assert (found < 0.01).mean() <= 0.05
    assert (found < 0.5).mean() < 0.75


def test_held_samples_are_left_out():
    history = flown(2, gusts=0.02)
    history.y[300:310] = np.nan
    history.roll[700] = np.nan

    assert p_of(history) < 1e-6


def test_a_roll_that_never_moves_tells_nothing():
    history = flown(3, gusts=0.02)

    assert not p_of(replace(history, roll=np.zeros(N))) < 0.01
    assert math.isnan(p_of(replace(history, roll=np.full(N, np.nan))))
    short = {name: getattr(history, name)[:120] for name in ("u", "y", "roll")}
    assert math.isnan(p_of(replace(history, **short)))


@pytest.mark.parametrize("n", [1, 2, 3, 4])
def test_a_record_shorter_than_the_lags_tells_nothing(n: int):
    """As a memory of a millisecond leaves; it was a traceback."""
    x = np.linspace(0.0, 1.0, n)
    history = History(x[:, None], x, x, x, x, x, x, {})

    assert np.isnan(roll_p(np.full(9, 0.1), CONFIG, history))
