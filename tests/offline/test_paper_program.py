"""The paper's listing fits every plant alike, because it explains y(k) by y(k)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from yawid.config.estimator import ArmaxOrders
from yawid.errors import ConfigError
from yawid.estimation.fit import fit_percent, simulate
from yawid.offline.paper_program import SAMPLE_TIME_S, paper_program
from yawid.offline.two_stage import two_stage
from yawid.plant.simulate import REFERENCE
from yawid.plant.yaw import YawPlant

PLANT = YawPlant.from_coefficients(REFERENCE)
DOUBLED = replace(PLANT, K=2.0 * PLANT.K)
STEP = np.concatenate([np.zeros(10), np.ones(990)])
ORDERS = ArmaxOrders(2, 2, 2, 1)


def measured(plant: YawPlant, output: str = "yaw-rate") -> np.ndarray:
    return plant.linear(output).simulate(STEP, SAMPLE_TIME_S)[:, 0]


@pytest.mark.parametrize("output", ["yaw-rate", "yaw"])
def test_the_listing_prints_what_the_paper_printed(output):
    """theta = [-1.0000, about 1e-11, anything] and "a fit of 100 %"."""
    found = paper_program(STEP, measured(PLANT, output))
    assert f"{found.theta1[0]:.4f}" == "-1.0000"
    assert abs(found.theta1[1]) < 1e-10
    assert found.theta1.shape == (3,)
    assert found.mse < 1e-20
    assert found.fit_pct == pytest.approx(100.0, abs=1e-6)


def test_the_first_regression_is_the_identity_to_rounding():
    y = measured(PLANT)
    found = paper_program(STEP, y)
    np.testing.assert_allclose(found.theta, [-1.0, 0.0], atol=1e-13)
    np.testing.assert_allclose(found.y_est, y, atol=1e-14)
    np.testing.assert_array_equal(found.error1, y - found.y_est)


def test_the_third_coefficient_multiplies_rounding_errors():
    """It may be anything: its column is twelve orders below y."""
    y = measured(PLANT)
    found = paper_program(STEP, y)
    assert np.abs(found.error1).max() < 1e-12 * np.abs(y).max()
    assert np.abs(found.theta1[2] * found.error1).max() < 1e-9 * np.abs(y).max()


def test_noise_without_any_plant_fits_just_as_well():
    u, y = np.random.default_rng(1).standard_normal((2, 500))
    found = paper_program(u, y)
    np.testing.assert_allclose(found.theta1[:2], [-1.0, 0.0], atol=1e-10)
    assert found.fit_pct == pytest.approx(100.0, abs=1e-6)


def test_the_listing_cannot_tell_a_plant_from_one_with_twice_its_gain():
    y, doubled = measured(PLANT), measured(DOUBLED)
    one, two = paper_program(STEP, y), paper_program(STEP, doubled)
    np.testing.assert_allclose(one.theta, two.theta, atol=1e-13)
    assert two.fit_pct == pytest.approx(100.0, abs=1e-6)
    # The "model" of the one plant fits the other's flight as well as its own.
    borrowed = np.stack([-doubled, STEP]).T @ one.theta
    assert fit_percent(doubled, borrowed) == pytest.approx(100.0, abs=1e-6)


@pytest.mark.parametrize("noise", [0.0, 1e-4])
def test_the_procedure_with_its_lags_tells_them_apart(noise):
    rng, models, flights = np.random.default_rng(2), [], []
    for plant in (PLANT, DOUBLED):
        y = measured(plant) + noise * rng.standard_normal(len(STEP))
        models.append(two_stage(STEP, y, ORDERS).theta)
        flights.append(measured(plant))
    gains = [theta[2:4].sum() / (1.0 + theta[:2].sum()) for theta in models]
    assert gains == pytest.approx([PLANT.K, DOUBLED.K], rel=0.05 if noise else 1e-6)
    own, borrowed = (
        fit_percent(flights[1], simulate(theta, ORDERS, False, STEP[:, None], flights[1]))
        for theta in (models[1], models[0])
    )
    assert own > 90.0
    assert borrowed < 60.0


def test_a_record_with_gaps_is_refused():
    with pytest.raises(ConfigError, match="without gaps"):
        paper_program(STEP, np.where(STEP > 0.0, np.nan, STEP))
