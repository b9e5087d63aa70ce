"""The recursive filter, products of records and the chi-square tail against SciPy and NumPy."""

from __future__ import annotations

import math
import threading

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import lfilter, lfiltic
from scipy.special import gammaincc

import yawid.estimation.all_pole as module
from yawid.estimation.all_pole import all_pole
from yawid.estimation.machine.products import cross
from yawid.estimation.machine.runner import RUNNER
from yawid.estimation.whiteness import chi_square_tail

lengths = st.sampled_from([0, 1, 2, 63, 400])
poles = st.lists(st.floats(-0.99, 0.99), max_size=4)


@given(poles=poles, n=lengths, seed=st.integers(0, 2**32 - 1))
def test_all_pole_is_scipys_recursion(poles, n, seed):
    rng = np.random.default_rng(seed)
    a = np.poly(poles)[1:] if poles else np.zeros(0)
    drive, past = rng.normal(size=n), rng.normal(size=len(a))
    denominator = np.concatenate([[1.0], a])
    state = lfiltic([1.0], denominator, past) if len(a) else None
    expected = lfilter([1.0], denominator, drive, zi=state)[0] if state is not None and n else drive
    # Poles that lie together, all near 1, make of a rounding 1e16 times as much.
    scale = 1.0 + np.abs(expected).max(initial=0.0)
    assert np.abs(all_pole(a, drive, past) - expected).max(initial=0.0) < 1e-9 * scale


@given(poles=poles, n=lengths, width=st.integers(1, 4), seed=st.integers(0, 2**32 - 1))
def test_a_filter_at_rest_has_the_bits_of_the_filter_with_a_past_of_zeros(poles, n, width, seed):
    a = np.poly(poles)[1:] if poles else np.zeros(0)
    drive = np.random.default_rng(seed).normal(size=(n, width))
    assert np.array_equal(all_pole(a, drive), all_pole(a, drive, np.zeros((len(a), width))))


def test_what_is_not_stable_overflows_without_a_warning():
    x = all_pole(np.array([-2.0]), np.ones(5000), np.zeros(1))
    assert np.array_equal(x[:50], 2.0 ** np.arange(1, 51) - 1.0)
    assert not np.isfinite(x[1100:]).any()


def test_a_long_record_is_filtered_beside_other_threads():
    drive, times, is_over = np.ones(10_000_000), [0], threading.Event()

    def count() -> None:
        while not is_over.wait(0.001):
            times[0] += 1

    other = threading.Thread(target=count, daemon=True)
    other.start()
    x = drive[:, None]
    before = times[0]
    filtered = all_pole(np.array([-0.5]), x, np.zeros((1, 1)))
    counted = times[0] - before
    is_over.set()
    other.join(60.0)
    assert filtered[-1, 0] == 2.0
    assert counted > 3


@given(poles=poles.filter(bool), n=lengths, width=st.integers(1, 12), seed=st.integers(0, 2**32))
def test_a_fit_without_compiled_code_and_by_all_of_scipy_gives_the_same_bits(poles, n, width, seed):
    rng = np.random.default_rng(seed)
    a, drive = np.poly(poles)[1:], rng.normal(size=(n, width))
    past, other = rng.normal(size=(len(a), width)), rng.normal(size=(n, 3))

    def found() -> list[np.ndarray]:
        products = cross(drive, other), cross(drive[:, :1], other[:, 0])
        return [all_pole(a, drive, past), all_pole(a, drive[:, 0]), *products]

    compiled = found()
    with pytest.MonkeyPatch.context() as monkeypatch:
        monkeypatch.setattr(RUNNER, "loop", lambda of: None)
        monkeypatch.setattr(module, "_lfilter", lambda: lfilter)  # as where C's part has moved
        plain = found()
    for one, same in zip(compiled, plain, strict=True):
        assert np.array_equal(one, same)


def test_each_column_is_filtered_by_itself_and_none_is_modified():
    a, drive, past = np.array([-0.5, 0.2]), np.eye(4, 3), np.ones((2, 3))
    together = all_pole(a, drive, past)
    for j in range(3):
        assert np.array_equal(together[:, j], all_pole(a, drive[:, j], past[:, j]))
    assert np.array_equal(drive, np.eye(4, 3))
    assert np.array_equal(past, np.ones((2, 3)))


@pytest.mark.parametrize("degrees", [1, 2, 3, 20, 25])
@pytest.mark.parametrize("q", [0.0, 1e-12, 0.3, 7.0, 25.0, 180.0, 1e4, math.inf])
def test_the_tail_of_chi_square_is_the_incomplete_gamma_function(q, degrees):
    expected = gammaincc(0.5 * degrees, 0.5 * q)
    assert chi_square_tail(q, degrees) == pytest.approx(expected, rel=1e-12, abs=1e-300)


def test_a_statistic_that_is_not_a_number_has_no_tail():
    assert math.isnan(chi_square_tail(math.nan, 20))


@given(
    shape=st.tuples(st.integers(0, 300), st.integers(1, 12), st.integers(1, 12)),
    seed=st.integers(0, 2**32 - 1),
)
def test_a_product_is_numpys_summed_row_after_row(shape, seed):
    n, m, width = shape
    rng = np.random.default_rng(seed)
    a, b = rng.normal(size=(n, m)), rng.normal(size=(n, width))
    rows = (a[:, :, None] * b[:, None, :]).reshape(n, m * width)
    expected = np.add.accumulate(np.vstack([np.zeros((1, m * width)), rows]))[-1]
    assert np.array_equal(cross(a, b), expected.reshape(m, width))
    assert np.array_equal(cross(a, b[:, 0]), expected.reshape(m, width)[:, 0])
