from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import freqz

from yawid.errors import ConfigError, NotIdentifiable
from yawid.physics.frequency_response import frequency_response
from yawid.plant.excitation import Excitation
from yawid.plant.yaw import YawPlant

TS = 0.05
PLANT = YawPlant(K=1.0, T_theta_s=0.8, omega_beta=2.5, xi_beta=0.4)
THETA = PLANT.theta(TS)


def answer(u: np.ndarray) -> np.ndarray:
    return PLANT.linear().simulate(u, TS)[:, 0]


def prbs(seconds: float, seed: int = 0) -> np.ndarray:
    return Excitation(kind="prbs", unit_s=0.2, seed=seed).samples(round(seconds / TS), TS)


def test_cross_spectra_measure_g_where_the_coherence_is_high():
    rng = np.random.default_rng(5)
    u = prbs(1200.0)
    y = answer(u) + 0.05 * rng.standard_normal(len(u))
    found = frequency_response(u, y, TS, 20.0)
    _, G = freqz([0.0, *THETA[2:]], [1.0, *THETA[:2]], worN=found.w, fs=2.0 * np.pi / TS)
    seen = (found.w > 0.6) & (found.w < 12.6)
    assert (found.coherence[seen] > 0.9).all()
    magnitude = (np.abs(found.G) - np.abs(G))[seen] / found.magnitude_std[seen]
    phase = np.angle(found.G / G)[seen] / found.phase_std_rad[seen]
    for miss in (magnitude, phase):
        assert np.sqrt(np.mean(miss**2)) == pytest.approx(1.0, abs=0.35)


def test_noise_alone_has_no_coherence():
    u, y = np.random.default_rng(6).standard_normal((2, 20_000))
    assert frequency_response(u, y, TS, 10.0).coherence.mean() < 0.02


U = prbs(60.0)


@pytest.mark.parametrize(
    ("u", "y", "segment_s", "error", "words"),
    [
        (np.ones(500), answer(np.ones(500)), 2.0, NotIdentifiable, "does not move"),
        (U, U, 50.0, ConfigError, "segment"),
        (U, U[1:], 2.0, ConfigError, "alike"),
        (U, np.where(U > 0.0, np.nan, U), 2.0, ConfigError, "without gaps"),
    ],
)
def test_what_says_nothing_is_refused(u, y, segment_s, error, words):
    with pytest.raises(error, match=words):
        frequency_response(u, y, TS, segment_s)
