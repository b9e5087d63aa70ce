"""Output error: the free run nearest to y, against scipy's search and the scatter of made noise."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.signal import cont2discrete, lfilter

from yawid import ArmaxOrders, EstimatorConfig
from yawid.blocks import Floats
from yawid.estimation.free_run import free_run_residuals, output_error, output_error_scores
from yawid.estimation.methods import METHODS
from yawid.estimation.prediction_error import RecordFit, stretches_of
from yawid.estimation.record_fit import fit_record, held_back_pct

A, B, BIAS = (-1.7, 0.8), (0.05, 0.04), 0.02
ORDERS = ArmaxOrders(2, 2, 1, 1)
CONFIG = EstimatorConfig(orders=ORDERS, sample_time_s=0.05, method="rml")
TRUE = np.array([*A, *B, 0.0, BIAS])


def driven(n: int, noise: float, seed: int, shaping: float = 0.0) -> tuple[Floats, Floats]:
    """u (n, 1) and y (n,): the output's own noise, which the model never sees, is white or slow"""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.choice([-0.2, 0.2], n // 8 + 1), 8)[:n]
    y = lfilter([0.0, *B], [1.0, *A], u) + lfilter([1.0], [1.0, *A], np.full(n, BIAS))
    left = lfilter([np.sqrt(1.0 - shaping**2)], [1.0, -shaping], rng.standard_normal(n))
    return u[:, None], y + noise * left


def record(u: Floats, y: Floats, breaks: tuple[int, ...] = ()) -> RecordFit:
    rows = np.column_stack([np.zeros(len(y)), y, u])
    rows[[0, *breaks], 0] = 1.0
    return RecordFit(CONFIG, list(stretches_of(CONFIG, rows)))


def test_it_is_the_least_free_run_error_that_scipy_finds():
    """The initial state is free there too: two more unknowns, by lfilter's delays"""
    u, y = driven(400, 0.02, 1)

    def left(x: Floats) -> Floats:
        drive = lfilter([0.0, *x[2:4]], [1.0], u[:, 0]) + x[4]
        return (y - lfilter([1.0], [1.0, *x[:2]], drive, zi=x[5:])[0])[2:]

    best = least_squares(left, [*A, *B, BIAS, 0.0, 0.0], xtol=1e-14, ftol=1e-14).x
    found = output_error(record(u, y), 1e-12)

    np.testing.assert_allclose(found[[0, 1, 2, 3, 5]], best[:5], atol=3e-4)
    assert found[4] == 0.0


def test_the_slope_is_that_of_the_free_run():
    """Less what initial states take up: both sides are projected by lstsq; over two stretches"""
    u, y = driven(200, 0.02, 2)
    fit = record(u, y, breaks=(90,))
    residuals = free_run_residuals(fit, TRUE)
    _, psi, eps = output_error_scores(fit, TRUE, residuals)

    first = len(residuals[0])
    for i, width in enumerate(psi.T):
        step = 1e-6 * np.eye(6)[i]
        ahead, behind = (np.concatenate(free_run_residuals(fit, TRUE + s)) for s in (step, -step))
        expected = np.zeros(len(eps)) if i == 4 else (behind - ahead) / 2e-6
        for rows in (slice(0, first), slice(first, None)):
            n = len(eps[rows])
            decays = np.column_stack(
                [lfilter([1.0], [1.0, *A], np.eye(n)[0]), lfilter([1.0], [1.0, *A], np.eye(n)[1])]
            )
            rest = [
                x[rows] - decays @ np.linalg.lstsq(decays, x[rows])[0] for x in (width, expected)
            ]
            np.testing.assert_allclose(*rest, atol=1e-5 * max(1.0, float(np.abs(width).max())))


@pytest.mark.parametrize("shaping", [0.0, 0.7], ids=["white", "slow"])
def test_sigma_is_the_scatter(shaping: float):
    """Residuals that are not white make it wider: the scores' autocorrelation is in it"""
    runs = [
        fit_record(CONFIG, *driven(600, 0.02, seed, shaping), method="oe") for seed in range(60)
    ]
    z = [(each.theta - TRUE)[:2] / np.sqrt(np.diag(each.covariance))[:2] for each in runs]

    assert np.sqrt(np.mean(np.square(z))) == pytest.approx(1.0, abs=0.3)


def test_it_explains_what_was_held_back_of_its_own_plant_and_no_noise():
    u, y = driven(600, 0.001, 5)
    assert held_back_pct(CONFIG, u, y, method="oe") > 98.0
    noise = np.random.default_rng(1).standard_normal(600)
    assert held_back_pct(CONFIG, u, noise, method="oe") < 10.0


def test_a_real_pole_that_the_first_steps_lost_is_found_again():
    """Of a 737 under its roll hold, by JSBSim's linearisation: pairs at 1.627 and 0.833 rad/s

    Without a real pole for the slower pair, the faster one takes its part and is 4.5 % too fast.
    """
    plant = [-0.525, -0.827, -0.700, -0.192], [1.0, 2.423, 4.777, 4.400, 1.836]
    numerator, denominator, step_s = cont2discrete(plant, 0.05)
    u = 0.2 * np.repeat([0, 1, -1, 0, -1, 1, 0], [20, 40, 40, 120, 40, 40, 300])
    config = EstimatorConfig(orders=ArmaxOrders(3, 3, 2, 1), sample_time_s=step_s, method="rml")
    wn = []
    for seed in range(8):
        y = lfilter(numerator[0], denominator, u)
        y = y + 0.008 * np.random.default_rng(seed).standard_normal(len(u))
        z = np.roots([1.0, *fit_record(config, u[:, None], y, method="oe").theta[:3]])
        wn.append(abs(np.log(z[z.imag > 0.0])).min() / step_s)

    assert np.mean(wn) == pytest.approx(1.627, rel=0.015)


def test_the_free_run_of_a_fit_is_kept_for_its_scores_and_for_no_other_theta():
    """The slope needs it again: a second fit, and a copy of theta, have their own"""
    u, y = driven(300, 0.02, 4)
    fit = record(u, y)
    found = output_error(fit, 1e-12)
    kept, again = (free_run_residuals(fit, theta)[0] for theta in (found, found.copy()))
    other = free_run_residuals(fit, TRUE)[0]

    assert free_run_residuals(fit, found)[0] is kept
    np.testing.assert_array_equal(kept, again)
    assert not np.array_equal(other, kept)


def test_gaps_begin_anew():
    u, y = driven(600, 0.005, 6)
    y[200:260] = np.nan
    y[260:] += 0.0
    found = fit_record(CONFIG, u, y, method="oe")

    np.testing.assert_allclose(found.theta[:2], A, atol=0.02)
    assert np.isnan(found.y_hat[200:262]).all()
    assert METHODS["oe"].runs_free
