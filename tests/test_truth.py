"""The right answer, from a plant whose truth is known, and a sigma that tells the scatter."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import cont2discrete, lfilter

from yawid import ArmaxOrders, EstimatorConfig, RecursiveArmax
from yawid.physics.modes import modes

WN, ZETA, TS = 2.5, 0.2, 0.1
ORDERS = ArmaxOrders(na=2, nb=2, nc=2, nk=1)


def dutch_roll(seed: int) -> np.ndarray:
    """RML on 120 s of eq. 23 (K = 1, T = 0.8 s) under a PRBS, with 5 % of output noise."""
    b, a, _ = cont2discrete((WN**2 * np.array([0.8, 1.0]), [1.0, 2 * ZETA * WN, WN**2]), TS)
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.choice([-0.2, 0.2], 300), 4)
    y = lfilter(np.ravel(b), a, u)
    y += 0.05 * y.std() * rng.standard_normal(len(y))
    armax = RecursiveArmax(EstimatorConfig(orders=ORDERS, sample_time_s=TS, method="rml"))
    block = armax.run(u, y, covariance=True)
    return modes(block, ORDERS, TS).dutch_roll[-1]


def test_wn_and_zeta_lie_within_three_sigma_and_sigma_is_the_scatter():
    found = np.array([dutch_roll(seed) for seed in range(200)])
    values, sigma = found[:, [0, 2]], found[:, [1, 3]]

    within = np.abs(values - [WN, ZETA]) < 3.0 * sigma
    assert (within.mean(axis=0) >= 0.98).all()
    assert np.median(sigma, axis=0) == pytest.approx(values.std(axis=0), rel=0.2)
