"""No slow death: wind-up, silence, wild numbers. Whole days are in tests/test_endurance.py."""

from __future__ import annotations

import numpy as np
import pytest
from estimation.armax_plants import S1, config, simulate, truth
from scipy.signal import lfilter

from yawid import RecursiveArmax, Status

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


def test_diverged_is_where_predictions_are_four_times_worse_than_none_until_they_are_twice():
    """Of mean squares over 100 updates; y's is that over the memory where that is larger."""
    u, y = simulate(((), (1.0, 0.5), (0.2,)), 3000, 2, noise=0.1)
    u[1000:1003] = 60.0  # which y does not show
    made = config(forgetting_factor=0.99, forgetting_start=0.99, scale_window=0)
    block = RecursiveArmax(made).run(u, y)
    s1 = y2 = fast_e2 = fast_y2 = 0.0
    expected = np.zeros(len(y), bool)
    for k in range(4, len(y)):  # two lags and two residuals come before the first update
        s1, y2 = 0.99 * s1 + 1.0, 0.99 * y2 + y[k] ** 2
        fast_e2 += 0.01 * (block.innovation[k] ** 2 - fast_e2)
        fast_y2 += 0.01 * (y[k] ** 2 - fast_y2)
        worse = fast_e2 * s1 / (max(fast_y2 * s1, y2) + 1e-4 * s1)
        expected[k] = k > 1000 and worse > (2.0 if expected[k - 1] else 4.0)
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
