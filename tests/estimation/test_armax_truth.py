"""Right answers: plants whose theta is known, the Cramer-Rao bound, intervals that cover."""

from __future__ import annotations

import numpy as np
import pytest
from estimation.armax_plants import S1, S2, S3, config, simulate, truth
from scipy.signal import lfilter

from yawid import ArmaxOrders, RecursiveArmax, Status
from yawid.estimation.polynomials import c_of, spr_margin
from yawid.plant.yaw import YawPlant


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


def ratios(plant, n, runs, **options):
    """q = d' CRB^-1 d / n_theta of each run: 1 on average is the bound."""
    orders = ArmaxOrders(len(plant[0]), len(plant[1]), len(plant[2]), 1)
    metric, q = information(plant), []
    for seed in range(runs):
        u, y = simulate(plant, n, seed)
        armax = RecursiveArmax(config(orders, bias=False, **options))
        miss = armax.run(u, y, keep="last").theta[0] - truth(plant)
        q.append(n * miss @ metric @ miss / len(miss))
    return np.array(q)


@pytest.mark.parametrize("plant", [S1, S2, S3], ids=["S1", "S2", "S3"])
@pytest.mark.parametrize(("start_buffer", "bound"), [(0, 1.8), (500, 1.25)])
def test_rml_comes_close_to_the_cramer_rao_bound_at_2000_samples(plant, start_buffer, bound):
    q = ratios(plant, 2000, 60, method="rml", start_buffer=start_buffer)
    assert q.max() < 100.0
    assert q.mean() < bound + 2.0 * q.std() / np.sqrt(len(q))


@pytest.mark.parametrize("plant", [S1, S2, S3], ids=["S1", "S2", "S3"])
def test_rml_meets_the_bound_at_10000_samples(plant):
    q = ratios(plant, 10_000, 40, method="rml")
    assert q.mean() < 1.25 + 2.0 * q.std() / np.sqrt(len(q))


def test_els_is_good_where_one_over_c_is_positive_real():
    q = ratios(S3, 10_000, 40, method="els")
    assert q.mean() < 1.6 + 2.0 * q.std() / np.sqrt(len(q))


def test_els_fails_on_the_known_counterexample_and_says_why():
    u, y = simulate(S2, 10_000, 1)
    armax = RecursiveArmax(config(ArmaxOrders(2, 1, 2, 1), bias=False))
    armax.run(u, y)
    assert np.max(np.abs(armax.theta - truth(S2))) > 0.05
    assert spr_margin(c_of(armax.theta, armax.config.orders)) < 0.0


@pytest.mark.parametrize("method", ["els", "rml"])
@pytest.mark.parametrize("forgetting_factor", [1.0, 0.995])
def test_95_percent_intervals_cover(method, forgetting_factor):
    """ELS on a model without C: there its sigma is exact too."""
    plant = S3 if method == "rml" else (S3[0], S3[1], ())
    orders = ArmaxOrders(2, 2, len(plant[2]), 1)
    inside = []
    for seed in range(60):
        u, y = simulate(plant, 3000, seed)
        made = config(orders, method=method, forgetting_factor=forgetting_factor, bias=False)
        block = RecursiveArmax(made).run(u, y)
        rows = slice(1499, None, 1500)
        inside.append(np.abs(block.theta[rows] - truth(plant)) <= 1.96 * block.theta_std[rows])
    assert 0.92 <= np.mean(inside) <= 0.98


def test_intervals_cover_where_an_order_is_too_low_because_sigma_knows_of_coloured_residuals():
    """The truth of the orders 1,2,2 is their estimate from 10^6 samples."""
    a1, a2, b1, b2 = YawPlant(K=1.0, T_theta_s=0.8, omega_beta=2.5, xi_beta=0.2).theta(0.02)

    def flown(n, seed):
        white, e = np.random.default_rng(seed).standard_normal((2, n))
        u = lfilter([np.sqrt(1.0 - 0.95**2)], [1.0, -0.95], white)
        coloured = lfilter((1.0, -1.3, 0.42), (1.0, a1, a2), e)
        return u, lfilter((0.0, b1, b2), (1.0, a1, a2), u) + 0.02 * coloured

    def runs(lags, n, seed, factor, keep):
        made = config(
            ArmaxOrders(1, 2, 2, 1), method="rml", bias=False, forgetting_factor=factor,
            residual_lags=lags,
        )  # fmt: skip
        return RecursiveArmax(made).run(*flown(n, seed), keep=keep)

    limit, covered = runs(0, 10**6, 999, 1.0, "last").theta[-1], {}
    for lags in (20, 0):
        blocks = [runs(lags, 20_000, seed, 0.998, "all") for seed in range(10)]
        misses = [abs(each.theta - limit) / each.theta_std for each in blocks]
        covered[lags] = np.mean([miss[1999::2000] <= 1.96 for miss in misses])

    assert covered[20] > 0.87
    assert covered[0] < 0.75


def test_noise_and_innovation_have_their_true_spread():
    u, y = simulate(S1, 20_000, 2, noise=0.3)
    armax = RecursiveArmax(config(method="rml"))
    last = armax.run(u, y, keep="last")
    assert last.noise_std[0] == pytest.approx(0.3, rel=0.02)
    assert armax.innovation_std == pytest.approx(0.3, rel=0.05)
    assert armax.residual_std == pytest.approx(0.3, rel=0.05)
    assert last.status[0] == Status.TRACKING


def test_whiteness_tells_the_right_order_from_one_too_low():
    u, y = simulate(S1, 10_000, 3)
    right = RecursiveArmax(config(method="rml"))
    low = RecursiveArmax(config(ArmaxOrders(1, 2, 0, 1), method="rml"))
    right.run(u, y)
    low.run(u, y)
    assert right.whiteness_p > 0.01
    assert low.whiteness_p < 1e-6


def test_whiteness_p_is_uniform_for_the_true_model():
    p = []
    for seed in range(80):
        u, y = simulate(S3, 3000, seed)
        armax = RecursiveArmax(config(method="rml", bias=False))
        armax.run(u, y, keep="last")
        p.append(armax.whiteness_p)
    assert 0.0 < np.mean(np.array(p) < 0.1) < 0.25
    assert 0.35 < np.mean(p) < 0.65


def test_it_follows_a_plant_that_changes_by_forgetting():
    u, y = simulate(S3, 6000, 5)
    later = simulate((S3[0], (2.0, 1.0), S3[2]), 6000, 6)
    u, y = np.concatenate([u, later[0]]), np.concatenate([y, later[1]])
    armax = RecursiveArmax(config(method="rml", forgetting_factor=0.99))
    last = armax.run(u, y, keep="last")
    np.testing.assert_allclose(last.theta[0, 2:4], [2.0, 1.0], atol=0.35)
    np.testing.assert_array_less(last.theta_std[0, 2:4], 0.15)
    keeps = RecursiveArmax(config(method="rml")).run(u, y, keep="last")
    assert np.max(np.abs(keeps.theta[0, 2:4] - [2.0, 1.0])) > 0.35


def test_the_start_fit_hands_over_the_prediction_error_estimate():
    u, y = simulate(S2, 501, 7)
    made = config(ArmaxOrders(2, 1, 2, 1), method="rml", bias=False, start_buffer=500)
    block = RecursiveArmax(made).run(u, y)
    assert not block.theta[498].any()
    assert block.status[498] == Status.WARMING_UP
    assert block.status[499] == Status.TRACKING
    miss = np.abs(block.theta[499] - truth(S2))
    np.testing.assert_array_less(miss, 4.0 * block.theta_std[499])
    assert block.theta_std[499].max() < 0.1
