from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import freqz

from yawid.config.estimator import ArmaxOrders
from yawid.errors import ConfigError, NotIdentifiable
from yawid.physics.response_curves import (
    answer_by_transient,
    answer_by_weighting,
    curves_from_data,
    curves_from_model,
    curves_from_step,
    frequency_response,
)
from yawid.plant.excitation import Excitation
from yawid.plant.yaw import YawPlant

TS = 0.05
PLANT = YawPlant(K=1.0, T_theta_s=0.8, omega_beta=2.5, xi_beta=0.4)
THETA = PLANT.theta(TS)
ORDERS = ArmaxOrders(2, 2, 0, 1)
MODEL = curves_from_model(THETA, ORDERS, TS, 400)


def answer(u: np.ndarray) -> np.ndarray:
    return PLANT.linear().simulate(u, TS)[:, 0]


def prbs(seconds: float, seed: int = 0) -> np.ndarray:
    return Excitation(kind="prbs", unit_s=0.2, seed=seed).samples(round(seconds / TS), TS)


def test_eq_2_and_3_give_the_plants_answer_to_any_held_input():
    u = np.random.default_rng(1).standard_normal(400)
    np.testing.assert_allclose(answer_by_transient(MODEL.h, u), answer(u), atol=1e-11)
    np.testing.assert_allclose(answer_by_weighting(MODEL.g, u, TS), answer(u), atol=1e-11)


def test_eq_3_adds_what_passes_at_once():
    u = np.random.default_rng(2).standard_normal(50)
    expected = 0.7 * u + answer(u)
    np.testing.assert_allclose(answer_by_weighting(MODEL.g, u, TS, h0=0.7), expected, atol=1e-12)


def test_a_step_measures_h_and_g():
    y = 4.0 + 2.0 * answer(np.ones(401))
    found = curves_from_step(np.concatenate([np.full(10, 4.0), y]), TS, u0=2.0, before=10)
    np.testing.assert_allclose(found.h, MODEL.h, atol=1e-12)
    np.testing.assert_allclose(found.g, MODEL.g, atol=1e-11)


def test_the_sigma_of_a_measured_h_and_g_is_their_scatter():
    rng, y = np.random.default_rng(3), answer(np.ones(401))
    runs = [curves_from_step(y + 0.02 * rng.standard_normal(401), TS, before=0) for _ in range(50)]
    h_miss = np.array([run.h[1:] - MODEL.h[1:] for run in runs]) / runs[0].h_std[1]
    g_miss = np.array([run.g - MODEL.g for run in runs]) / runs[0].g_std[0]
    assert np.sqrt(np.mean(h_miss**2)) == pytest.approx(1.0, abs=0.12)
    assert np.sqrt(np.mean(g_miss**2)) == pytest.approx(1.0, abs=0.12)


def test_any_input_measures_g_and_h_with_their_sigma():
    rng = np.random.default_rng(4)
    u = prbs(120.0)
    y = 1.5 + answer(u) + 0.05 * rng.standard_normal(len(u))
    found = curves_from_data(u, y, TS, 160)
    g_miss = (found.g - MODEL.g[:160]) / found.g_std
    h_miss = (found.h - MODEL.h[:160])[1:] / found.h_std[1:]
    assert np.sqrt(np.mean(g_miss**2)) == pytest.approx(1.0, abs=0.2)
    assert np.abs(h_miss).max() < 4.5
    np.testing.assert_allclose(found.h, MODEL.h[:160], atol=0.1)


def test_cross_spectra_measure_g_where_the_coherence_is_high():
    rng = np.random.default_rng(5)
    u = prbs(1200.0)
    y = answer(u) + 0.05 * rng.standard_normal(len(u))
    found = frequency_response(u, y, TS, 20.0)
    _, G = freqz([0.0, *THETA[2:]], [1.0, *THETA[:2]], worN=found.frequency_hz, fs=1.0 / TS)
    seen = (found.frequency_hz > 0.1) & (found.frequency_hz < 2.0)
    assert (found.coherence[seen] > 0.9).all()
    magnitude = (np.abs(found.G) - np.abs(G))[seen] / found.magnitude_std[seen]
    phase = np.angle(found.G / G)[seen] / found.phase_std_rad[seen]
    for miss in (magnitude, phase):
        assert np.sqrt(np.mean(miss**2)) == pytest.approx(1.0, abs=0.35)


def test_noise_alone_has_no_coherence():
    u, y = np.random.default_rng(6).standard_normal((2, 20_000))
    assert frequency_response(u, y, TS, 10.0).coherence.mean() < 0.02


def test_what_says_nothing_is_refused():
    u = prbs(60.0)
    with pytest.raises(NotIdentifiable, match="excites only 1 of the 21"):
        curves_from_data(np.ones(500), answer(np.ones(500)), TS, 20)
    with pytest.raises(NotIdentifiable, match="does not move"):
        frequency_response(np.ones(500), answer(np.ones(500)), TS, 2.0)
    with pytest.raises(ConfigError, match="segment"):
        frequency_response(u, u, TS, 50.0)
    with pytest.raises(ConfigError, match="length of 900"):
        curves_from_data(u, u, TS, 900)
    with pytest.raises(ConfigError, match="alike"):
        curves_from_data(u, u[1:], TS, 10)
    with pytest.raises(ConfigError, match="without gaps"):
        frequency_response(u, np.where(u > 0.0, np.nan, u), TS, 2.0)
    with pytest.raises(ConfigError, match="3 samples"):
        curves_from_step(u, TS, before=len(u))
    with pytest.raises(ConfigError, match="u0"):
        curves_from_step(u, TS, u0=0.0)
