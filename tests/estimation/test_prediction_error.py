from __future__ import annotations

import numpy as np
import pytest
from estimation.prediction_error import fit_prediction_error
from scipy.optimize import least_squares
from scipy.signal import lfilter

from yawid.config.estimator import ArmaxOrders
from yawid.errors import ConfigError, NotIdentifiable
from yawid.plant.excitation import Excitation
from yawid.plant.simulate import REFERENCE, simulate_plant
from yawid.plant.yaw import YawPlant

ORDERS = ArmaxOrders(2, 1, 2, 1)
A, B, C = (0.9, 0.95), (1.0,), (1.5, 0.75)
TRUTH = np.array(A + B + C)


def flown(samples: int = 2000, seed: int = 0):
    """The plant on which extended least squares fails."""
    u, e = np.random.default_rng(seed).standard_normal((2, samples))
    return u, lfilter((0.0, *B), (1.0, *A), u) + lfilter((1.0, *C), (1.0, *A), e)


def residuals(theta, u, y):
    """eps = (A y - B u)/C from rest, after the lags."""
    k = np.arange(2, len(y))
    equation = y[k] + theta[0] * y[k - 1] + theta[1] * y[k - 2] - theta[2] * u[k - 1]
    return lfilter([1.0], [1.0, *theta[3:]], equation)


def test_it_is_the_least_loss_that_an_independent_search_finds():
    u, y = flown()
    found = fit_prediction_error(u, y, ORDERS)
    search = least_squares(residuals, TRUTH, args=(u, y), xtol=1e-14, ftol=1e-14, gtol=1e-14)
    assert np.abs((found.theta - search.x) / found.theta_std).max() < 0.01
    covariance = np.linalg.inv(search.jac.T @ search.jac) * 2.0 * search.cost / (len(y) - 7)
    np.testing.assert_allclose(found.covariance, covariance, rtol=0.02, atol=1e-7)
    assert found.noise_std == pytest.approx(np.sqrt(2.0 * search.cost / (len(y) - 7)), rel=0.005)


def test_sigma_is_the_scatter():
    misses = []
    for seed in range(40):
        found = fit_prediction_error(*flown(1000, seed), ORDERS)
        misses.append((found.theta - TRUTH) / found.theta_std)
    assert np.sqrt(np.mean(np.square(misses))) == pytest.approx(1.0, abs=0.15)


def test_a_flight_without_noise_gives_the_sampled_plant_back():
    flight = simulate_plant("yaw", Excitation(kind="prbs", amplitude=0.1), sample_time_s=0.1)
    found = fit_prediction_error(flight.u, flight.y, ArmaxOrders(2, 2, 0, 1))
    truth = YawPlant.from_coefficients(REFERENCE).theta(0.1)
    np.testing.assert_allclose(found.theta, truth, rtol=1e-5)
    assert found.simulation_pct > 99.99


def test_a_gap_and_a_constant_do_no_harm():
    u, y = flown()
    y[800:810] = np.nan
    whole = fit_prediction_error(*flown(), ORDERS)
    found = fit_prediction_error(u, y + 10.0, ORDERS, bias=True)
    assert np.abs((found.theta[:5] - whole.theta) / whole.theta_std).max() < 1.0
    assert found.theta[5] == pytest.approx(10.0 * (1.0 + sum(A)), abs=0.5)


def test_what_cannot_be_fitted_is_refused():
    u, y = flown(300)
    with pytest.raises(NotIdentifiable, match="does not move"):
        fit_prediction_error(np.ones(300), y, ORDERS)
    with pytest.raises(ConfigError, match="too few"):
        fit_prediction_error(u[:15], y[:15], ORDERS)
    with pytest.raises(ConfigError, match="shape"):
        fit_prediction_error(u[1:], y, ORDERS)
    with pytest.raises(ConfigError, match="infinite"):
        fit_prediction_error(u, np.where(y > 1.0, np.inf, y), ORDERS)
