"""What RecursiveArmax promises: right answers, gaps, the window, saving, no wind-up.

Plants have a known theta, and the Cramer-Rao bound. Silence, wild numbers and poor excitation are
no slow death; days are in tests/test_endurance.py.
"""

from __future__ import annotations

import hashlib
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from estimation.armax_plants import S1, S2, S3, config, simulate, truth
from scipy.signal import lfilter

from yawid import ArmaxOrders, ConfigError, RecursiveArmax, Status, parameter_names
from yawid.estimation.polynomials import c_of, spr_margin
from yawid.plant.yaw import YawPlant


def test_bytes_of_another_version_or_none_at_all_are_refused():
    saved = RecursiveArmax(config()).to_bytes()
    for junk, words in (
        (saved.replace(b"yawid-armax-4", b"yawid-armax-0"), "yawid-armax-0"),
        (saved[:-8], "bytes"),
        *((each, None) for each in (b"", b"hello", b"[1]\n", b"{}\n")),
    ):
        with pytest.raises(ConfigError, match=words):
            RecursiveArmax.from_bytes(junk)


def test_what_lies_before_a_gap_is_no_neighbour_of_what_follows():
    u, y = simulate(S1, 900, 5)
    armax = RecursiveArmax(config(bias=False))
    armax.run(u[:600], y[:600])
    armax.update(float("nan"), float("nan"))
    armax.run(u[600:602] + 1e6, y[600:602] + 1e6)  # fills the lags, but is never regressed upon
    armax.update(float("nan"), float("nan"))
    after = armax.run(u[602:], y[602:])
    np.testing.assert_allclose(after.theta[-1], [*S1[0], *S1[1], *S1[2]], atol=0.3)
    assert np.nanmax(np.abs(after.innovation)) < 10.0


def test_the_window_holds_updates_back_until_every_channel_moves():
    u, y = simulate(S1, 600, 6)
    armax = RecursiveArmax(config())
    still = armax.run(np.full(250, 0.3), y[:250])
    assert (still.status == Status.WARMING_UP).all()
    assert not still.theta.any()
    assert np.isnan(still.y_hat).all()
    assert armax.updates == 0
    moving = armax.run(u, y)
    assert moving.theta[0].any()  # one sample that moves, among a hundred, is a spread
    assert armax.updates + armax.held == 850
    assert moving.status[-1] == Status.TRACKING


def test_held_samples_in_the_window_break_it_but_lose_no_others():
    u, y = simulate(S1, 130, 7)
    armax = RecursiveArmax(config())
    armax.run(np.insert(u, [10, 60], np.nan), np.insert(y, [10, 60], np.nan))
    lags = 4
    assert (armax.updates, armax.held) == (130 - 3 * lags, 2 + 3 * lags)


def test_scales_change_nothing_but_the_prior():
    u, y = simulate(S1, 3000, 8)
    plain = RecursiveArmax(config(method="rml")).run(u, y, keep="last").theta[0]
    scaled = RecursiveArmax(config(method="rml")).run(u * 1024.0, y * 64.0, keep="last").theta[0]
    units = np.array([1, 1, 1 / 16, 1 / 16, 1, 1, 64])
    np.testing.assert_array_equal(scaled, plain * units)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"forgetting_factor": 0.0}, r"forgetting_factor must lie in \(0, 1\], got 0.0"),
        ({"forgetting_factor": 1.01}, r"forgetting_factor must lie in \(0, 1\], got 1.01"),
        ({"forgetting_factor": float("nan")}, "forgetting_factor"),
        ({"P0": -1.0}, "P0 must be > 0 and finite, got -1.0"),
        ({"method": "lms"}, "method"),
        ({"sample_time_s": 0.0}, "sample_time_s"),
        ({"scale_window": -1}, "scale_window"),
        ({"start_buffer": 1.5}, "start_buffer"),
        ({"residual_lags": -1}, "residual_lags"),
        ({"scale_minimum": -1.0}, "scale_minimum"),
        ({"information_floor": -0.1}, "information_floor"),
        ({"orders": (2, 2, 2, 1)}, "ArmaxOrders"),
    ],
)
def test_a_setting_outside_its_limits_is_named(options, words):
    with pytest.raises(ConfigError, match=words):
        replace(config(), **options)
    with pytest.raises(ConfigError, match="zero everywhere"):
        ArmaxOrders(0, 0, 0, 1)


def test_parameters_are_named_in_theta_order():
    orders = ArmaxOrders(2, (1, 2), 1, (1, 1))
    names = parameter_names(orders, ("rudder", "aileron"), bias=True)
    assert names == ("a1", "a2", "b1", "b1_aileron", "b2_aileron", "c1", "bias")
    with pytest.raises(ValueError, match="1 input names"):
        parameter_names(orders)


def test_the_places_in_a_save_are_those_of_its_version() -> None:
    """Nothing is reckoned yet, so these are the same bytes on every machine."""
    orders = ArmaxOrders(2, (2, 1), 2, (1, 3))
    made = config(orders, method="rml", forgetting_factor=0.98, start_buffer=60)
    digest = hashlib.sha256(RecursiveArmax(made).to_bytes()).hexdigest()
    assert digest.startswith("fd81ede50d72f"), "another layout needs another VERSION"


POOR = {
    "silence": np.zeros((2, 50_000)),
    "one sine": np.sin(0.1 * np.arange(50_000) - np.array([[0.0], [1.0]])),
}
"""u and y: the textbook recursion overflows after 35 000 samples."""


@pytest.mark.parametrize("method", ["els", "rml"])
@pytest.mark.parametrize("kind", POOR)
@pytest.mark.parametrize("floor", [0.0, 0.1])
def test_hours_without_excitation_overflow_nothing_and_do_not_slow_the_return(method, kind, floor):
    armax = RecursiveArmax(config(method=method, forgetting_factor=0.98, information_floor=floor))
    armax.run(*simulate(S1, 2000, 0))
    armax.run(*POOR[kind], keep="last")
    assert np.isfinite([*armax.theta, *armax.P.flat]).all()
    assert np.linalg.eigvalsh(armax.P)[0] > 0.0
    back = armax.run(*simulate(S1, 2000, 1), keep="last")
    np.testing.assert_allclose(back.theta[0, :6], truth(S1), atol=1.0)


@pytest.mark.parametrize("method", ["els", "rml"])
def test_a_number_that_overflows_means_diverged_and_then_recovery(method):
    u, y = simulate(S1, 3000, 2)
    y[1000] = 1e200
    armax = RecursiveArmax(config(method=method))
    block = armax.run(u, y)
    assert block.status[1000] == Status.DIVERGED
    assert np.isfinite(block.theta).all()
    assert armax.restarts == 1
    flips = np.flatnonzero(np.diff((block.status == Status.DIVERGED).astype(int)))
    assert len(flips) == 2  # once in, once out: the way back asks for more than the way in
    assert flips[1] - flips[0] > 140  # twice the updates of warming up
    assert block.status[-1] == Status.TRACKING
    np.testing.assert_allclose(block.theta[-1, :6], truth(S1), atol=0.4)


@pytest.mark.parametrize(("size", "first"), [(60.0, 27.2), (23.22, 4.2), (22.21, 3.85)])
def test_diverged_is_where_predictions_are_four_times_worse_than_none_until_they_are_twice(
    size, first
):
    """Of mean squares over 100 updates; y's is that over the memory where that is larger."""
    u, y = simulate(((), (1.0, 0.5), (0.2,)), 3000, 2, noise=0.1)
    u[1000:1003] = size  # which y does not show
    made = config(forgetting_factor=0.99, forgetting_start=0.99, scale_window=0)
    block = RecursiveArmax(made).run(u, y)
    s1 = y2 = fast_e2 = fast_y2 = 0.0
    expected, worse = np.zeros(len(y), bool), np.zeros(len(y))
    for k in range(4, len(y)):  # two lags and two residuals come before the first update
        s1, y2 = 0.99 * s1 + 1.0, 0.99 * y2 + y[k] ** 2
        fast_e2 += 0.01 * (block.innovation[k] ** 2 - fast_e2)
        fast_y2 += 0.01 * (y[k] ** 2 - fast_y2)
        worse[k] = fast_e2 * s1 / (max(fast_y2 * s1, y2) + 1e-4 * s1)
        expected[k] = k > 1000 and worse[k] > (2.0 if expected[k - 1] else 4.0)
    assert worse[1001] == pytest.approx(first, rel=0.02)  # just above the limit, and just below
    assert 20 < expected.sum() < 1000
    np.testing.assert_array_equal(block.status == Status.DIVERGED, expected)
    assert np.sum(block.status == Status.WARMING_UP) == 4 + 10 * 7 - 1


def test_a_huge_but_finite_outlier_is_survived():
    u, y = simulate(S1, 60_000, 3)
    y[1000] = 1e8
    armax = RecursiveArmax(config(method="rml", forgetting_factor=0.99))
    last = armax.run(u, y, keep="last")
    np.testing.assert_allclose(last.theta[0, :6], truth(S1), atol=0.6)


def test_c_stays_stable_at_every_step():
    rng = np.random.default_rng(4)
    u, e = rng.standard_normal((2, 3000))
    y = lfilter([1.0, -1.98, 0.99], [1.0, -0.5], e) + 0.1 * u
    armax = RecursiveArmax(config(method="rml", bias=False, forgetting_factor=0.97))
    block = armax.run(u, y)
    for c1, c2 in block.theta[:, 4:6]:
        assert np.abs(np.roots([1.0, c1, c2])).max() < 1.0
    assert armax.halved > 0


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
