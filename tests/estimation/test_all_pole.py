"""Arithmetic over records against SciPy, NumPy and by hand: filter, zeros, fits, steps, tails."""

from __future__ import annotations

import math
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from estimation.armax_plants import S1, simulate, truth
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import lfilter, lfiltic
from scipy.special import gammaincc

import yawid.estimation.all_pole as module
from yawid import ArmaxOrders
from yawid.estimation.all_pole import all_pole
from yawid.estimation.fit import fit_percent
from yawid.estimation.fit import simulate as simulated
from yawid.estimation.grids import as_held
from yawid.estimation.machine.products import cross
from yawid.estimation.machine.runner import RUNNER
from yawid.estimation.polynomials import reflected
from yawid.estimation.whiteness import chi_square_tail

poles = st.lists(st.floats(-0.99, 0.99), min_size=1, max_size=4)


@given(
    poles=poles,
    n=st.sampled_from([0, 1, 2, 63, 300]),
    width=st.integers(1, 12),
    seed=st.integers(0, 2**32 - 1),
)
def test_filter_and_products_are_scipys_and_numpys_with_and_without_compiled_code(
    poles, n, width, seed
):
    rng = np.random.default_rng(seed)
    a, drive, other = np.poly(poles)[1:], rng.normal(size=(n, width)), rng.normal(size=(n, 3))
    past = rng.normal(size=(len(a), width))
    before = drive.copy(), past.copy()

    def found() -> list[np.ndarray]:
        at_rest = all_pole(a, drive), all_pole(a, drive, 0.0 * past)
        products = cross(drive, other), cross(drive[:, :1], other[:, 0])
        return [all_pole(a, drive, past), *at_rest, all_pole(a, drive[:, 0]), *products]

    compiled = found()
    with pytest.MonkeyPatch.context() as monkeypatch:
        monkeypatch.setattr(RUNNER, "loop", lambda of: None)
        monkeypatch.setattr(module, "_lfilter", lambda: lfilter)  # as where C's part has moved
        plain = found()
    for one, same in zip([*compiled, drive, past], [*plain, *before], strict=True):
        assert np.array_equal(one, same)
    whole, at_rest, zeros, alone, product, narrow = compiled
    assert np.array_equal(at_rest, zeros)
    assert np.array_equal(at_rest[:, 0], alone)
    rows = (drive[:, :, None] * other[:, None, :]).reshape(n, 3 * width)
    summed = np.add.accumulate(np.vstack([np.zeros((1, 3 * width)), rows]))[-1].reshape(width, 3)
    assert np.array_equal(product, summed)
    assert np.array_equal(narrow, summed[:1, 0])
    for j in range(width if n else 0):
        state = lfiltic([1.0], [1.0, *a], past[:, j])
        expected = lfilter([1.0], [1.0, *a], drive[:, j], zi=state)[0]
        # Poles that lie together, all near 1, make of a rounding 1e16 times as much.
        assert np.abs(whole[:, j] - expected).max() < 1e-9 * (1.0 + np.abs(expected).max())


def test_what_is_not_stable_overflows_without_a_warning():
    x = all_pole(np.array([-2.0]), np.ones(5000), np.zeros(1))
    assert np.array_equal(x[:50], 2.0 ** np.arange(1, 51) - 1.0)
    assert not np.isfinite(x[1100:]).any()


def test_a_long_record_is_filtered_beside_other_threads():
    drive, counted, end_s = np.ones((10_000_000, 1)), 0, time.monotonic() + 60.0
    with ThreadPoolExecutor(1) as pool:
        filtering = pool.submit(all_pole, np.array([-0.5]), drive, np.zeros((1, 1)))
        while not filtering.done() and time.monotonic() < end_s:
            time.sleep(0.001)
            counted += 1
        assert filtering.result(60.0)[-1, 0] == 2.0
    assert counted > 3


@pytest.mark.parametrize("degrees", [1, 2, 3, 20, 25])
@pytest.mark.parametrize("q", [0.0, 1e-12, 0.3, 7.0, 25.0, 180.0, 1e4, math.inf, math.nan])
def test_the_tail_of_chi_square_is_the_incomplete_gamma_function(q, degrees):
    expected = gammaincc(0.5 * degrees, 0.5 * q)
    found = chi_square_tail(q, degrees)
    assert found == pytest.approx(expected, rel=1e-12, abs=1e-300, nan_ok=True)


@pytest.mark.parametrize(
    ("zeros", "inside"),
    [
        ([2.0, 0.5], [0.5, 0.5]),
        ([0.99, -1.25], [0.98, -0.8]),
        ([1j, -1j], [0.98j, -0.98j]),
        ([1.0 + 1.0j, 1.0 - 1.0j, 0.0], [0.5 + 0.5j, 0.5 - 0.5j, 0.0]),
        ([math.nan, 0.5], [0.0, 0.0]),
    ],
)
def test_zeros_outside_of_the_unit_circle_are_reflected_and_held_within_098(zeros, inside):
    c, expected = (np.poly(np.array(each))[1:] for each in (zeros, inside))
    np.testing.assert_allclose(reflected(c), expected, atol=1e-12)


def test_a_simulation_begins_again_after_each_gap_and_its_fit_is_a_share_of_ys_spread():
    orders, theta = ArmaxOrders(2, 2, 2, 1), np.append(truth(S1), 0.7)
    u, y = simulate(S1, 300, 1, noise=0.0)
    y += 0.7 / (1.0 + sum(S1[0]))
    u[100], y[[180, 182]] = np.nan, np.nan
    found = simulated(theta, orders, True, u[:, None], y)
    lags = [0, 1, 100, 101, 102, *range(180, 185)]
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(found)), lags)
    np.testing.assert_allclose(found[2:100], y[2:100], atol=1e-9)
    np.testing.assert_allclose(found[185:], y[185:], atol=1e-9)
    runaway = simulated(
        np.array([-3.0, 0.0, *theta[2:]]), orders, True, np.ones((2000, 1)), y[:1].repeat(2000)
    )
    assert np.isposinf(runaway[-1])
    for y_hat, pct in ((y, 100.0), (0.75 * y + 0.25 * np.nanmean(y), 75.0), (1e9 * y, -1000.0)):
        assert fit_percent(y, y_hat) == pytest.approx(pct)
    for flat in (np.ones(9), y[180:183]):
        assert math.isnan(fit_percent(flat, flat))


def test_a_ramp_loses_nothing_and_a_parabola_what_its_means_add():
    t = np.arange(20.0)
    ramp, parabola = t + 0.5, t**2 + t + 1.0 / 3.0  # the means of t and of t squared

    inner, everywhere = slice(2, -2), np.ones(20, bool)
    np.testing.assert_allclose(as_held(ramp[:, None], everywhere)[inner, 0], ramp[inner])
    # Held, v acts as its own mean once more: its second difference / 12 is taken off, 2 / 12.
    np.testing.assert_allclose(
        as_held(parabola[:, None], everywhere)[inner, 0], parabola[inner] - 1.0 / 6.0
    )


def test_what_moves_at_the_instants_or_next_to_a_missing_sample_stays():
    u = np.random.default_rng(2).standard_normal((30, 2))
    u[10] = np.nan

    np.testing.assert_array_equal(as_held(u, np.zeros(30, bool)), u)
    rests = np.where(np.isnan(u), np.nan, 1.0)
    np.testing.assert_array_equal(as_held(rests, np.ones(30, bool)), rests)
