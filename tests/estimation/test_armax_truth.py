"""Right answers: plants whose theta is known, the Cramer-Rao bound, intervals that cover."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from estimation.armax_plants import S1, S2, S3, config, simulate, truth
from scipy.signal import lfilter

from yawid import ArmaxOrders, RecursiveArmax
from yawid.estimation.polynomials import c_of, spr_margin
from yawid.plant.yaw import YawPlant


@cache
def information(plant):
    """E[psi psi'] / noise variance for white u and e of unit variance, psi at the true theta."""
    a, b, c = plant
    poles, n = (1.0, *a), 200_000
    u, e = np.random.default_rng(99).standard_normal((2, n))
    y = lfilter((0.0, *b), poles, u) + lfilter((1.0, *c), poles, e)
    filtered = [lfilter([1.0], (1.0, *c), x) for x in (-y, u, e)]
    psi = [
        np.roll(x, i + 1) for x, k in zip(filtered, (a, b, c), strict=True) for i in range(len(k))
    ]
    psi = np.array(psi)[:, 100:]
    return psi @ psi.T / psi.shape[1]


@pytest.mark.parametrize(
    ("plant", "method", "n", "start_buffer", "bound"),
    [
        *((plant, "rml", 2000, 0, 1.8) for plant in (S1, S2, S3)),
        *((plant, "rml", 2000, 500, 1.25) for plant in (S1, S2, S3)),
        *((plant, "rml", 10_000, 0, 1.25) for plant in (S1, S2, S3)),
        (S3, "els", 10_000, 0, 1.6),  # where 1/C is positive real
    ],
)
def test_theta_comes_close_to_the_cramer_rao_bound(plant, method, n, start_buffer, bound):
    """q = d' CRB^-1 d / n_theta of a run is 1 on average at the bound."""
    orders = ArmaxOrders(len(plant[0]), len(plant[1]), len(plant[2]), 1)
    made, q = config(orders, bias=False, method=method, start_buffer=start_buffer), []
    for seed in range(40):
        last = RecursiveArmax(made).run(*simulate(plant, n, seed), keep="last")
        miss = last.theta[0] - truth(plant)
        q.append(n * miss @ information(plant) @ miss / len(miss))
    assert max(q) < 100.0
    assert np.mean(q) < bound + 2.0 * np.std(q) / np.sqrt(len(q))


def test_els_fails_on_the_known_counterexample_and_says_why():
    armax = RecursiveArmax(config(ArmaxOrders(2, 1, 2, 1), bias=False))
    armax.run(*simulate(S2, 10_000, 1))
    assert np.max(np.abs(armax.theta - truth(S2))) > 0.05
    assert spr_margin(c_of(armax.theta, armax.config.orders)) < 0.0
    assert spr_margin(np.array([0.5])) == pytest.approx(1.0 / 1.5 - 0.5)  # at q = 1


@pytest.mark.parametrize("method", ["els", "rml"])
@pytest.mark.parametrize("forgetting_factor", [1.0, 0.995])
def test_intervals_cover_and_residuals_are_white_and_of_the_noises_size(method, forgetting_factor):
    """ELS on a model without C: there its sigma is exact too."""
    plant = S3 if method == "rml" else (S3[0], S3[1], ())
    orders = ArmaxOrders(2, 2, len(plant[2]), 1)
    made = config(orders, method=method, forgetting_factor=forgetting_factor, bias=False)
    inside, p, sizes = [], [], []
    for seed in range(60):
        armax = RecursiveArmax(made)
        block = armax.run(*simulate(plant, 3000, seed, noise=0.3))
        rows = slice(1499, None, 1500)
        inside.append(np.abs(block.theta[rows] - truth(plant)) <= 1.96 * block.theta_std[rows])
        p.append(armax.whiteness_p)
        sizes.append([armax.noise_std, armax.innovation_std, armax.residual_std])
    assert 0.92 <= np.mean(inside) <= 0.98
    assert 0.0 < np.mean(np.array(p) < 0.1) < 0.25
    assert 0.35 < np.mean(p) < 0.65
    assert np.mean(sizes, axis=0) == pytest.approx([0.3] * 3, rel=0.05)


def test_intervals_cover_where_an_order_is_too_low_because_sigma_knows_of_coloured_residuals():
    """The truth of the orders 1,2,2 is their estimate from 10^6 samples."""
    a1, a2, b1, b2 = YawPlant(K=1.0, T_theta_s=0.8, omega_beta=2.5, xi_beta=0.2).theta(0.02)

    def run(lags, n, seed, factor):
        white, e = np.random.default_rng(seed).standard_normal((2, n))
        u = lfilter([np.sqrt(1.0 - 0.95**2)], [1.0, -0.95], white)
        coloured = lfilter((1.0, -1.3, 0.42), (1.0, a1, a2), e)
        armax = RecursiveArmax(
            config(ArmaxOrders(1, 2, 2, 1), method="rml", bias=False, forgetting_factor=factor,
                   residual_lags=lags)
        )  # fmt: skip
        y = lfilter((0.0, b1, b2), (1.0, a1, a2), u) + 0.02 * coloured
        return armax, armax.run(u, y, keep="all" if n < 10**6 else "last")

    limit, covered = run(0, 10**6, 999, 1.0)[0].theta, {}
    for lags in (20, 0):
        found = [run(lags, 20_000, seed, 0.998) for seed in range(10)]
        misses = [abs(block.theta - limit) / block.theta_std for _, block in found]
        covered[lags] = np.mean([miss[1999::2000] <= 1.96 for miss in misses])
        assert lags == 0 or max(armax.whiteness_p for armax, _ in found) < 1e-6

    assert covered[20] > 0.87
    assert covered[0] < 0.75


def test_it_follows_a_plant_that_changes_by_forgetting():
    blocks = simulate(S3, 6000, 5), simulate((S3[0], (2.0, 1.0), S3[2]), 6000, 6)
    u, y = np.concatenate(blocks, axis=1)
    last, keeps = (
        RecursiveArmax(config(method="rml", forgetting_factor=factor)).run(u, y, keep="last")
        for factor in (0.99, 1.0)
    )
    np.testing.assert_allclose(last.theta[0, 2:4], [2.0, 1.0], atol=0.35)
    np.testing.assert_array_less(last.theta_std[0, 2:4], 0.15)
    assert np.max(np.abs(keeps.theta[0, 2:4] - [2.0, 1.0])) > 0.35
