"""What the stream has estimated at its end: its numbers, with the sigma of P and no verdict."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.signal import cont2discrete, lfilter

from yawid.blocks import SampleBlock
from yawid.config.run import RunConfig
from yawid.estimation.armax import RecursiveArmax
from yawid.estimation.bank import Bank
from yawid.estimation.fit import fit_percent, simulate
from yawid.results.summary import dutch_roll_of_stream, of_stream

TS = 0.1
KEEPS_ALL = RunConfig(memory=math.inf)


def flown(n: int, wn: float = 2.4, seed: int = 6) -> tuple[np.ndarray, np.ndarray]:
    """Rudder and yaw rate of eq. 23 (zeta 0.25, T 0.8 s) with one percent of noise."""
    b, a, _ = cont2discrete((wn**2 * np.array([0.8, 1.0]), [1.0, 0.5 * wn, wn**2]), TS)
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.choice([-0.2, 0.2], n // 5 + 1), 5)[:n]
    y = lfilter(np.ravel(b), a, u)
    return u, y + 0.01 * y.std() * rng.standard_normal(n)


def samples(u: np.ndarray, y: np.ndarray) -> SampleBlock:
    k, zero = np.arange(len(y)), np.zeros(len(y))
    stamp = (k * TS * 1e6).astype(np.int64)
    columns = [k, stamp, 1000 * stamp, stamp, u[:, None], y, *[zero] * 4, *[np.zeros_like(k)] * 3]
    columns += [np.full(len(y), np.nan)] * 7
    return SampleBlock(TS, *columns)


def bank_of(u: np.ndarray, y: np.ndarray) -> Bank:
    bank = Bank(KEEPS_ALL, TS)
    bank.run(samples(u, y))
    return bank


@pytest.mark.parametrize("method", ["els", "rml"])
def test_theta_sigma_and_fits_are_those_of_the_recursion_by_itself(method):
    u, y = flown(900)
    y[100:110] = np.nan

    found = of_stream(bank_of(u, y))[method]

    armax = RecursiveArmax(KEEPS_ALL.estimator(method, TS))
    block = armax.run(u, y)
    assert list(found.theta.values()) == armax.theta.tolist()
    assert list(found.theta_std.values()) == block.theta_std[-1].tolist()
    simulated = simulate(armax.theta, armax.config.orders, True, u[:, None], y)
    assert found.fit.simulation_pct == pytest.approx(fit_percent(y, simulated), abs=1e-9)
    assert found.fit.one_step_pct == pytest.approx(fit_percent(y, block.y_hat), abs=1e-9)
    assert (found.updates, found.held) == (armax.updates, armax.held)
    roll, of_eq_23 = found.dutch_roll, ("K", "T_theta_s", "omega_beta", "xi_beta")
    assert (roll.wn_std_noise, roll.zeta_std_noise, roll.level) == (
        roll.wn_std,
        roll.zeta_std,
        None,
    )
    assert all(found.physics[name].std == found.physics[name].std_noise > 0.0 for name in of_eq_23)


def test_a_bank_without_a_dutch_roll_has_none():
    bank = bank_of(np.zeros(300), np.zeros(300))

    assert dutch_roll_of_stream(bank, "els") is None
    assert of_stream(bank)["els"].dutch_roll is None
