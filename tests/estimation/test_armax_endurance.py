"""No slow death: wind-up, silence, wild numbers."""

from __future__ import annotations

import numpy as np
import pytest
from estimation.armax_plants import S1, config, simulate, truth
from scipy.signal import lfilter

from yawid import RecursiveArmax, Status

PATTERNS = ("silent input", "dead silence", "trim")


def cycle(pattern: str, gain: float, seed: int, poor: int):
    """2000 excited samples of S1, then poor ones."""
    u, e = np.random.default_rng(seed).standard_normal((2, 2000 + poor))
    u[2000:] = 0.3 if pattern == "trim" else 0.0
    if pattern == "dead silence":
        e[2000:] = 0.0
    a, b, c = S1
    poles = (1.0, *a)
    return u, lfilter((0.0, *(gain * np.array(b))), poles, u) + lfilter((1.0, *c), poles, e)


@pytest.mark.parametrize("method", ["els", "rml"])
@pytest.mark.parametrize("pattern", PATTERNS)
def test_poor_excitation_neither_winds_up_nor_slows_the_return(method, pattern):
    armax = RecursiveArmax(config(method=method, forgetting_factor=0.98, bias=False))
    gains = []
    for number in range(8):
        gain = 1.5 if number % 2 else 1.0
        u, y = cycle(pattern, gain, number, poor=30_000)
        back = armax.run(u[:300], y[:300])
        rest = armax.run(u[300:], y[300:])
        assert (rest.status == Status.TRACKING).all()
        P = armax.P
        assert np.linalg.eigvalsh(P)[0] > 0.0
        assert P.max() < 10.0
        expected = truth(S1)
        expected[2:4] *= gain
        if number:
            assert np.abs(rest.theta - expected).max() < 2.5
            gains.append(back.theta[-1, 2:4].sum() / (1.5 * gain) - 1.0)
    assert abs(np.mean(gains)) < 0.1


@pytest.mark.parametrize("floor", [0.0, 0.1])
def test_a_day_of_silence_overflows_nothing(floor):
    """86 400 s at 20 Hz would be 1.7 million samples; P grows no more after the first 100 000."""
    made = config(forgetting_factor=0.98, information_floor=floor)
    armax = RecursiveArmax(made)
    armax.run(*simulate(S1, 2000, 0))
    for _ in range(4):
        armax.run(np.zeros(100_000), np.zeros(100_000), keep="last")
    assert np.isfinite(armax.P).all()
    assert np.linalg.eigvalsh(armax.P)[0] > 0.0
    back = armax.run(*simulate(S1, 2000, 1), keep="last")
    np.testing.assert_allclose(back.theta[0, :6], truth(S1), atol=1.0)


def test_a_day_of_one_sine_overflows_nothing():
    t = np.arange(300_000)
    armax = RecursiveArmax(config(method="rml", forgetting_factor=0.995))
    armax.run(np.sin(0.1 * t), np.sin(0.1 * t - 1.0), keep="last")
    assert np.isfinite(armax.theta).all()
    assert np.linalg.eigvalsh(armax.P)[0] > 0.0


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
    assert flips[1] - flips[0] > 70
    assert block.status[-1] == Status.TRACKING
    np.testing.assert_allclose(block.theta[-1, :6], truth(S1), atol=0.4)


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
