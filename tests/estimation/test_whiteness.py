"""How much residuals have in common with those before: a size, beside the p-value of a test."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import lfilter

from yawid.blocks import Floats
from yawid.estimation.whiteness import largest_autocorrelation


def ar1(pole: float, n: int, seed: int) -> Floats:
    return lfilter([1.0], [1.0, -pole], np.random.default_rng(seed).standard_normal(n))


@given(pole=st.floats(-0.95, 0.95), lags=st.integers(1, 30), seed=st.integers(0, 100))
def test_the_largest_autocorrelation_is_numpys(pole: float, lags: int, seed: int):
    eps = ar1(pole, 300, seed)
    whole = np.correlate(eps, eps, "full")[299:]

    expected = np.max(np.abs(whole[1 : lags + 1])) / whole[0]
    assert largest_autocorrelation(eps, lags) == pytest.approx(expected)
    assert largest_autocorrelation(1e-6 * eps, lags) == pytest.approx(expected)


@pytest.mark.parametrize("pole", [-0.7, 0.0, 0.3, 0.7])
def test_it_is_the_pole_of_what_each_has_of_the_one_before(pole: float):
    assert largest_autocorrelation(ar1(pole, 20_000, 1)) == pytest.approx(abs(pole), abs=0.03)


@given(gone=st.sets(st.integers(0, 299), max_size=150))
def test_pairs_with_a_missing_one_are_left_out(gone: set[int]):
    """A gap in the middle makes no neighbours of what stands on either side"""
    eps = ar1(0.6, 300, 2)
    eps[list(gone)] = np.nan
    known = np.isfinite(eps)

    sums = [
        sum(eps[k] * eps[k - lag] for k in range(lag, 300) if known[k] and known[k - lag])
        for lag in range(21)
    ]
    expected = max(abs(each) for each in sums[1:]) / sums[0]
    assert largest_autocorrelation(eps) == pytest.approx(expected)


@pytest.mark.parametrize(
    "eps", [np.zeros(100), np.full(100, np.nan), ar1(0.5, 39, 3), np.zeros(0)], ids=len
)
def test_too_few_and_none_that_move_have_none(eps: Floats):
    assert np.isnan(largest_autocorrelation(eps))
