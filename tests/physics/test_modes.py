from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.signal import cont2discrete

from yawid.blocks import EstimateBlock
from yawid.config.estimator import ArmaxOrders
from yawid.physics.modes import mode_list, modes
from yawid.quantities.flying_qualities import dutch_roll_level

ORDERS = ArmaxOrders(na=3, nb=3, nc=0, nk=1)


def sampled(numerator: list[float], denominator: list[float], ts: float) -> np.ndarray:
    """theta = [a, b] of a continuous model behind a zero-order hold, by scipy."""
    b, a, _ = cont2discrete((numerator, denominator), ts, method="zoh")
    return np.concatenate([a[1:], np.ravel(b)[1:]])


def yaw_with_servo(wn: float, zeta: float, gain: float, lead: float, tau: float) -> tuple:
    """Eq. 23 for the yaw rate behind a first-order servo."""
    denominator = np.polymul([1.0, 2.0 * zeta * wn, wn**2], [tau, 1.0])
    return gain * wn**2 * np.array([lead, 1.0]), denominator


def estimates(theta: np.ndarray, covariance: np.ndarray | None = None) -> EstimateBlock:
    theta = np.atleast_2d(theta)
    n, p = theta.shape
    zero = np.zeros(n)
    if covariance is not None:
        covariance = np.broadcast_to(covariance, (n, p, p))
    return EstimateBlock.of(theta, theta, covariance, zero, zero, zero, zero, zero.astype(np.uint8))


@given(
    wn=st.floats(0.7, 15.0),
    zeta=st.floats(0.05, 0.95),
    tau=st.floats(0.05, 0.5),
    lead=st.floats(0.1, 2.0),
    ts=st.sampled_from([0.02, 0.05, 0.1]),
)
def test_the_dutch_roll_of_a_sampled_plant_comes_back(wn, zeta, tau, lead, ts):
    pole = 1.0 / tau
    separation = abs(complex(pole - zeta * wn, wn * math.sqrt(1 - zeta**2)))
    assume(wn * ts <= 2.0 and separation >= 0.3 and wn <= 0.8 * math.pi * 0.8 / ts)
    theta = sampled(*yaw_with_servo(wn, zeta, 1.0, lead, tau), ts)

    found = modes(estimates(theta), ORDERS, ts)

    # A pair that hardly answers (its zero sits on it) is still the only oscillatory one.
    np.testing.assert_allclose(found.dutch_roll[0, [0, 2]], [wn, zeta], rtol=1e-5)
    real = [mode for mode in mode_list(found) if mode["kind"] == "real"]
    assert real[0]["time_constant_s"] == pytest.approx(tau, rel=1e-5)


def test_of_two_pairs_the_one_with_more_energy_is_the_dutch_roll():
    strong, weak = (2.5, 0.2), (12.0, 0.1)
    denominators = [[1.0, 2 * z * w, w * w] for w, z in (strong, weak)]
    # Sum of the two: the strong one answers ten times as much.
    numerator = np.polyadd(np.polymul([10.0], denominators[1]), np.polymul([1.0], denominators[0]))
    ts = 0.05
    b, a, _ = cont2discrete((numerator, np.polymul(*denominators)), ts, method="zoh")
    theta = np.concatenate([a[1:], np.ravel(b)[1:]])

    found = modes(estimates(theta), ArmaxOrders(na=4, nb=4, nc=0, nk=1), ts)

    np.testing.assert_allclose(found.dutch_roll[0, [0, 2]], strong, rtol=1e-6)


def test_sigma_by_the_delta_method_is_the_scatter_of_the_poles():
    ts, rng = 0.1, np.random.default_rng(3)
    theta = sampled(*yaw_with_servo(2.4, 0.25, 1.0, 0.8, 0.2), ts)
    root = 1e-4 * rng.standard_normal((6, 6))
    covariance = root @ root.T
    scattered = rng.multivariate_normal(theta, covariance, size=4000)

    found = modes(estimates(theta, covariance), ORDERS, ts).dutch_roll[0]
    spread = modes(estimates(scattered), ORDERS, ts).dutch_roll

    assert found[1] == pytest.approx(spread[:, 0].std(), rel=0.05)
    assert found[3] == pytest.approx(spread[:, 2].std(), rel=0.05)


def test_a_pole_on_the_negative_axis_is_no_mode_and_hides_none():
    ts = 0.1
    pair = np.exp(complex(-0.5, 2.3) * ts)
    a = np.poly([pair, np.conj(pair), -0.4]).real[1:]

    found = modes(estimates(np.concatenate([a, [0.1, 0.0, 0.0]]), np.eye(6)), ORDERS, ts)

    listed = mode_list(found)
    assert [mode["kind"] for mode in listed] == ["oscillatory"]
    assert found.dutch_roll[0, 0] == pytest.approx(math.hypot(0.5, 2.3), rel=1e-9)
    assert np.isfinite(found.dutch_roll).all()


def test_an_unstable_pair_is_reported_as_it_is():
    ts = 0.1
    pair = np.exp(complex(0.3, 2.3) * ts)
    a = np.poly([pair, np.conj(pair), 0.5]).real[1:]

    found = modes(estimates(np.concatenate([a, [0.1, 0.0, 0.0]])), ORDERS, ts)

    assert found.dutch_roll[0, 2] == pytest.approx(-0.3 / math.hypot(0.3, 2.3), rel=1e-9)


def test_no_estimate_yet_has_no_modes():
    found = modes(estimates(np.zeros(6)), ORDERS, 0.1)

    assert np.isnan(found.dutch_roll).all()
    assert mode_list(found) == []


@given(cut=st.integers(1, 19), seed=st.integers(0, 50))
def test_a_rows_bits_do_not_depend_on_the_block_it_came_in(cut, seed):
    rng = np.random.default_rng(seed)
    theta = 0.5 * rng.standard_normal((20, 6))
    root = rng.standard_normal((6, 6))
    covariance = root @ root.T

    whole = modes(estimates(theta, covariance), ORDERS, 0.05)
    parts = [modes(estimates(t, covariance), ORDERS, 0.05) for t in (theta[:cut], theta[cut:])]

    for name in whole.__slots__:
        joined = np.concatenate([getattr(part, name) for part in parts])
        np.testing.assert_array_equal(joined, getattr(whole, name), err_msg=name)


def test_levels_need_all_three_limits():
    assert dutch_roll_level(2.4, 0.23) == 1
    assert dutch_roll_level(2.4, 0.07) == 2
    assert dutch_roll_level(2.4, 0.01) == 3
    assert dutch_roll_level(0.3, 0.5) is None
    assert dutch_roll_level(2.4, -0.1) is None


def test_a_model_without_a_has_no_modes():
    orders = ArmaxOrders(na=0, nb=2, nc=0, nk=1)

    found = modes(estimates(np.array([0.1, 0.2]), np.eye(2)), orders, 0.1)

    assert np.isnan(found.dutch_roll).all()
    assert mode_list(found) == []


@pytest.mark.parametrize("size", [1, 2, 3, 8])
def test_the_bits_of_a_row_do_not_depend_on_the_blocks_length_even_where_it_has_no_modes(size):
    """NaN has a sign, and which one comes out depends on how many are computed at once."""
    theta = np.zeros((64, 6))
    theta[10:20, :3] = np.random.default_rng(0).normal(size=(10, 3))
    theta[30] = np.nan
    whole = modes(estimates(theta, np.eye(6)), ORDERS, 0.1)
    parts = [
        modes(estimates(theta[i : i + size], np.eye(6)), ORDERS, 0.1) for i in range(0, 64, size)
    ]

    for name in ("poles", "wn", "wn_std", "zeta", "zeta_std", "dutch_roll"):
        joined = np.concatenate([getattr(part, name) for part in parts])
        assert joined.tobytes() == getattr(whole, name).tobytes(), name
