"""The grid of the contract: what a rudder that switches tells of wn, zeta, K and T of eq. 23."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm

from yawid import ArmaxOrders, EstimatorConfig, RecursiveArmax
from yawid.physics.derivatives import yaw_channel
from yawid.plant.yaw import YawPlant

PLANT = YawPlant(K=1.0, T_theta_s=0.8, omega_beta=2.5, xi_beta=0.2)
TRUTH = np.array([PLANT.K, PLANT.T_theta_s, PLANT.omega_beta, PLANT.xi_beta])


def off(u: np.ndarray, y: np.ndarray, ts: float, nb: int, method: str) -> np.ndarray:
    """Relative errors (4,) of K, T, wn and zeta as the estimator finds them."""
    orders = ArmaxOrders(2, nb, 2, 1)
    armax = RecursiveArmax(EstimatorConfig(orders=orders, sample_time_s=ts, method=method))
    armax.run(u, y, keep="last")
    values, _ = yaw_channel(armax.theta[None], orders, ts)
    return np.abs(values[0, :4] / TRUTH - 1.0)


def flown(seed: int, ts: float, count: int = 600) -> tuple[np.ndarray, np.ndarray]:
    """The rudder's mean over each [t_k, t_k+1) and the rate at t_k; it switches at any time."""
    rng = np.random.default_rng(seed)
    switches = np.sort(rng.uniform(5.0 * ts, (count - 10.0) * ts, count // 10))
    levels = dict(zip(switches, rng.uniform(-0.5, 0.5, len(switches)), strict=True))
    plant = PLANT.linear()
    moving = np.zeros((3, 3))
    moving[:2] = np.hstack([plant.A, plant.B])
    grid = set((np.arange(count + 1) * ts).tolist())
    u, y, state, level, now, k = np.zeros(count), [], np.zeros(2), 0.0, 0.0, -1
    for t in sorted({*grid, *switches}):
        state = (expm(moving * (t - now)) @ np.append(state, level))[:2]
        if k >= 0:
            u[k] += level * (t - now) / ts
        if t in grid:
            y.append((plant.C @ state)[0])
            k += 1
        now, level = t, levels.get(t, level)
    return u, np.array(y[:count])


@pytest.mark.parametrize("method", ["els", "rml"])
@pytest.mark.parametrize("seed", range(3))
def test_an_input_that_switches_on_the_grid_gives_all_four_numbers_to_1e_6(method, seed):
    """Without noise; what is left, 6e-7 of T, is the prior P0 = 100."""
    u = np.repeat(np.random.default_rng(seed).choice([-0.2, 0.2], 300), 4)
    y = PLANT.linear().simulate(u, 0.1)[:, 0]
    assert off(u, y, 0.1, 2, method).max() < 1e-6


@pytest.mark.parametrize("method", ["els", "rml"])
@pytest.mark.parametrize("wn_ts", [0.05, 0.125, 0.25])
def test_an_input_that_switches_anywhere_is_well_within_1_percent_of_wn_and_5_of_k(method, wn_ts):
    """Without noise, nb = 3; measured over 12 seeds: 0.03 % of wn, 0.2 of zeta, 0.7 of K and T."""
    errors = [off(*flown(seed, wn_ts / 2.5), wn_ts / 2.5, 3, method) for seed in range(3)]
    K, T, wn, zeta = np.max(errors, axis=0)
    assert max(wn, zeta) < 0.003
    assert max(K, T) < 0.01
