"""Two-stage least squares and the paper's listing, and the comparison of orders."""

from __future__ import annotations

import numpy as np
import pytest
from places import C172P
from printed import printed
from scipy.signal import lfilter

from yawid.cli.main import main
from yawid.config.estimator import ArmaxOrders
from yawid.config.run import RunConfig
from yawid.errors import ConfigError, NotIdentifiable
from yawid.estimation.fit import fit_percent, simulate
from yawid.estimation.polynomials import c_of, spr_margin
from yawid.offline.orders import CANDIDATES, compare_orders
from yawid.offline.two_stage import paper_listing, two_stage
from yawid.plant.simulate import REFERENCE
from yawid.plant.yaw import YawPlant

ORDERS = ArmaxOrders(2, 2, 2, 1)
A, B, C = (-0.8, 0.15), (1.0, 0.5), (0.5, 0.1)
TRUTH = np.array(A + B + C)


def flown(samples: int = 2000, seed: int = 0, noise: float = 1.0, c: tuple[float, ...] = C):
    u, e = np.random.default_rng(seed).standard_normal((2, samples))
    driven = lfilter((0.0, *B), (1.0, *A), u)
    return u, driven + noise * lfilter((1.0, *c), (1.0, *A), e)


def test_it_finds_theta_within_its_sigma():
    found = [two_stage(*flown(seed=seed), ORDERS) for seed in range(20)]
    misses = np.array([(each.theta - TRUTH) / each.theta_std for each in found])
    assert all(each.converged for each in found)
    assert np.sqrt(np.mean(misses[:, :4] ** 2)) == pytest.approx(1.0, abs=0.25)
    assert np.abs(misses).max() < 5.0


def test_at_the_fixed_point_eq_30_to_33_hold_together():
    """eps is y less phi' theta with eps itself in phi, and theta is the least-squares one."""
    u, y = flown()
    found = two_stage(u, y, ORDERS)
    eps, theta = found.residual, found.theta
    k = np.arange(2, len(y))
    past = np.where(np.isfinite(eps), eps, 0.0)
    phi = np.column_stack([-y[k - 1], -y[k - 2], u[k - 1], u[k - 2], past[k - 1], past[k - 2]])
    np.testing.assert_allclose(eps[k], y[k] - phi @ theta, atol=1e-12)
    np.testing.assert_allclose(theta, np.linalg.lstsq(phi, y[k], rcond=None)[0], atol=1e-6)
    assert np.isnan(eps[:2]).all()
    assert np.nanstd(eps) == pytest.approx(1.0, rel=0.05)


def test_the_first_stage_is_arx_and_is_biased_where_c_is_not_1():
    found = two_stage(*flown(20_000), ORDERS)
    assert np.abs(found.arx - TRUTH[:4]).max() > 0.1
    assert np.abs(found.theta - TRUTH).max() < 0.03
    assert spr_margin(c_of(found.theta, ORDERS)) > 0.0


def test_a_constant_is_told_from_the_plant():
    u, y = flown()
    found = two_stage(u, y + 7.0, ORDERS, bias=True)
    np.testing.assert_allclose(found.theta[:6], two_stage(u, y, ORDERS).theta, atol=0.02)
    assert found.theta[6] == pytest.approx(7.0 * (1.0 + sum(A)), abs=0.2)


def test_without_noise_theta_is_exact_and_c_is_said_to_be_unknown():
    found = two_stage(*flown(noise=0.0), ORDERS)
    np.testing.assert_allclose(found.theta[:4], TRUTH[:4], atol=1e-12)
    assert np.isinf(found.theta_std[4:]).all()
    assert not found.theta[4:].any()


def test_a_gap_costs_only_the_samples_whose_lags_reach_it():
    u, y = flown()
    y[700:705], u[1400] = np.nan, np.nan
    found = two_stage(u, y, ORDERS)
    assert np.flatnonzero(np.isnan(found.residual)).tolist() == [0, 1, *range(700, 707), 1401, 1402]
    np.testing.assert_allclose(found.theta, two_stage(*flown(), ORDERS).theta, atol=0.02)


def test_without_c_one_least_squares_is_all_and_inputs_keep_their_order():
    rng = np.random.default_rng(8)
    u = rng.standard_normal((1000, 2))
    y = lfilter((0.0, *B), (1.0, *A), u[:, 0]) + lfilter((0.0, 0.0, 3.0), (1.0, *A), u[:, 1])
    found = two_stage(u, y, ArmaxOrders(2, (2, 1), 0, (1, 2)))
    np.testing.assert_allclose(found.theta, [*A, *B, 3.0], atol=1e-12)
    np.testing.assert_array_equal(found.theta, found.arx)
    assert found.converged


def test_a_c_that_the_iteration_cannot_reach_is_admitted():
    """Ljung's counterexample to extended least squares: the SPR margin is negative."""
    u, e = np.random.default_rng(3).standard_normal((2, 2000))
    a = (1.0, 0.9, 0.95)
    y = lfilter((0.0, 1.0), a, u) + lfilter((1.0, 1.5, 0.75), a, e)
    found = two_stage(u, y, ArmaxOrders(2, 1, 2, 1))
    assert not found.converged
    assert spr_margin(np.array([1.5, 0.75])) < 0.0


U, Y = flown(200)


@pytest.mark.parametrize(
    ("u", "y", "error", "words"),
    [
        (np.ones(200), Y, NotIdentifiable, "excites"),
        (U[:12], Y[:12], ConfigError, "too few"),
        (U[1:], Y, ConfigError, "u must have shape"),
        (U, np.where(Y > 1.0, np.inf, Y), ConfigError, "infinite"),
    ],
)
def test_what_cannot_be_fitted_is_refused(u, y, error, words):
    with pytest.raises(error, match=words):
        two_stage(u, y, ORDERS, bias=True)


PLANT = YawPlant.from_coefficients(REFERENCE)
STEP = np.concatenate([np.zeros(10), np.ones(990)])


def measured(gain: float = 1.0, output: str = "yaw-rate") -> np.ndarray:
    return gain * PLANT.linear(output).simulate(STEP, 0.01)[:, 0]


@pytest.mark.parametrize("output", ["yaw-rate", "yaw"])
def test_the_paper_s_listing_prints_what_the_paper_printed(output):
    """theta1 = [-1.0000, about 1e-11, anything], a mean square error of 1e-22, a fit of 100 %."""
    y = measured(output=output)
    theta1, y_est1 = paper_listing(STEP, y)
    assert f"{theta1[0]:.4f}" == "-1.0000"
    assert abs(theta1[1]) < 1e-10
    assert np.mean((y - y_est1) ** 2) < 1e-20
    assert fit_percent(y, y_est1) == pytest.approx(100.0, abs=1e-6)


def test_noise_without_any_plant_and_another_plant_fit_the_listing_just_as_well():
    u, y = np.random.default_rng(1).standard_normal((2, 500))
    theta1, y_est1 = paper_listing(u, y)
    np.testing.assert_allclose(theta1[:2], [-1.0, 0.0], atol=1e-10)
    assert fit_percent(y, y_est1) == pytest.approx(100.0, abs=1e-6)
    doubled = measured(2.0)
    borrowed = np.stack([-doubled, STEP]).T @ paper_listing(STEP, measured())[0][:2]
    assert fit_percent(doubled, borrowed) == pytest.approx(100.0, abs=1e-6)


@pytest.mark.parametrize("noise", [0.0, 1e-4])
def test_the_procedure_with_its_lags_tells_a_plant_from_one_with_twice_its_gain(noise):
    rng = np.random.default_rng(2)
    models = [
        two_stage(STEP, measured(gain) + noise * rng.standard_normal(1000), ORDERS).theta
        for gain in (1.0, 2.0)
    ]
    gains = [theta[2:4].sum() / (1.0 + theta[:2].sum()) for theta in models]
    assert gains == pytest.approx([PLANT.K, 2.0 * PLANT.K], rel=0.05 if noise else 1e-6)
    flown = measured(2.0)
    own, borrowed = (
        fit_percent(flown, simulate(theta, ORDERS, False, STEP[:, None], flown))
        for theta in (models[1], models[0])
    )
    assert own > 90.0
    assert borrowed < 60.0


def second_order(n: int, nk: int, noise: float) -> tuple[np.ndarray, np.ndarray]:
    rng, a = np.random.default_rng(11), [1.0, -1.6, 0.8]
    u = np.repeat(rng.choice([-1.0, 1.0], n // 8 + 1), 8)[:n]
    e = lfilter([1.0, -0.7], a, noise * rng.standard_normal(n))
    return u[:, None], lfilter([*[0.0] * nk, 0.5, 0.3], a, u) + e


@pytest.mark.parametrize("nk", [1, 2])
def test_the_structure_that_made_the_record_is_recommended(nk: int):
    u, y = second_order(1500, nk, 0.3)
    tried = [(na, na, nc, k) for na in (1, 2, 3) for nc in (0, 1) for k in (1, 2, 3)]

    found, best = compare_orders(u, y, 0.1, RunConfig(), tried)

    assert (best.na, best.nb, best.nk) == (2, 2, nk)
    assert [c.simulation_pct for c in found] == sorted(
        (c.simulation_pct for c in found), reverse=True
    )
    [chosen] = [c for c in found if str(c) == str(best)]
    assert chosen.loss == pytest.approx(0.09, rel=0.15)


def test_held_samples_do_not_count_and_too_few_are_refused():
    u, y = second_order(400, 1, 0.1)
    y[:250] = np.nan

    with pytest.raises(NotIdentifiable, match="150 samples"):
        compare_orders(u, y, 0.1, RunConfig())


def test_the_candidates_cover_the_default_and_fit_two_inputs_and_the_yaw_angle():
    assert RunConfig().orders in CANDIDATES
    config = RunConfig(inputs=("rudder", "aileron"), output="yaw")
    u, y = second_order(1500, 1, 0.3)
    both = np.column_stack([u, np.roll(u, 17)])
    [found], _ = compare_orders(both, y, 0.1, config, [(2, 2, 1, 1)])
    assert str(found) == "2,2,1,1"


def test_orders_takes_the_manoeuvre_s_samples_says_its_rule_and_marks_its_row(capsys):
    options = ["orders", str(C172P), "--rate", "10"]
    assert main([*options, "--json"]) == 0
    report = printed("orders", capsys.readouterr().out)
    assert main(options) == 0
    shown = capsys.readouterr().out.splitlines()

    best = ",".join(str(report["recommended"][name]) for name in ("na", "nb", "nc", "nk"))
    assert report["manoeuvres"] == 1
    assert report["recommended"]["nk"] == 1
    assert [line.split()[1] for line in shown if line.startswith("->")] == [best]
    assert "1 manoeuvres' samples" in " ".join(shown)
    assert "ns" not in shown[1].split()
