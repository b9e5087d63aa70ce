"""Modes of blocks, modes and yaw channel of a stream of estimates."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.signal import cont2discrete

from yawid.blocks import EstimateBlock, Status
from yawid.config.estimator import ArmaxOrders
from yawid.physics.derivatives import with_sigma
from yawid.physics.modes import mode_list, modes
from yawid.physics.stage import PhysicsStage
from yawid.quantities.flying_qualities import dutch_roll_level
from yawid.quantities.table import YAW_CHANNEL

ORDERS = ArmaxOrders(na=3, nb=3, nc=0, nk=1)


def sampled(numerator: list[float], denominator: list[float], ts: float) -> np.ndarray:
    """theta = [a, b] of a continuous model behind a zero-order hold, by scipy."""
    b, a, _ = cont2discrete((numerator, denominator), ts, method="zoh")
    return np.concatenate([a[1:], np.ravel(b)[1:]])


def yaw_with_servo(wn: float, zeta: float, gain: float, lead: float, tau: float) -> tuple:
    """Eq. 23 for the yaw rate behind a first-order servo."""
    denominator = np.polymul([1.0, 2.0 * zeta * wn, wn**2], [tau, 1.0])
    return gain * wn**2 * np.array([lead, 1.0]), denominator


def estimates(
    theta: np.ndarray, covariance: np.ndarray | None = None, status: np.ndarray | int = 0
) -> EstimateBlock:
    theta = np.atleast_2d(theta)
    n, p = theta.shape
    zero = np.zeros(n)
    if covariance is not None:
        covariance = np.broadcast_to(covariance, (n, p, p))
    status = np.broadcast_to(np.uint8(status), n)
    return EstimateBlock.of(theta, theta, covariance, zero, zero, zero, zero, status)


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


def with_poles(*poles: complex, ts: float = 0.1) -> np.ndarray:
    """theta of real poles as they are sampled and of pairs in 1/s."""
    z = [x for p in poles for x in ([p] if p.imag == 0.0 else np.exp([p * ts, p.conjugate() * ts]))]
    return np.concatenate([np.real(np.poly(z))[1:], [0.1], np.zeros(len(z) - 1)])


def two_pairs() -> np.ndarray:
    """Of 2.5 and 12 rad/s: the slow one answers ten times as much."""
    slow, fast = [1.0, 1.0, 6.25], [1.0, 2.4, 144.0]
    return sampled(np.polyadd(np.polymul([10.0], fast), slow), np.polymul(slow, fast), 0.1)


PAIR = complex(-0.5, 2.3)
OTHER = math.hypot(0.3, 2.3)


@pytest.mark.parametrize(
    ("theta", "dutch_roll", "kinds"),
    [
        pytest.param(two_pairs(), (2.5, 0.2), ["oscillatory"] * 2, id="of two pairs the stronger"),
        pytest.param(
            with_poles(PAIR, -0.4), (abs(PAIR), 0.5 / abs(PAIR)), ["oscillatory"],
            id="a pole on the negative axis is no mode and hides none",
        ),
        pytest.param(
            with_poles(complex(0.3, 2.3), 0.5), (OTHER, -0.3 / OTHER), ["oscillatory", "real"],
            id="an unstable pair",
        ),
        pytest.param(np.zeros(6), (math.nan, math.nan), [], id="no estimate yet"),
        pytest.param(np.array([0.1, 0.2]), (math.nan, math.nan), [], id="no A"),
    ],
)  # fmt: skip
def test_the_dutch_roll_is_the_pair_that_answers_most(
    theta: np.ndarray, dutch_roll: tuple[float, float], kinds: list[str]
):
    na = 0 if len(theta) == 2 else len(theta) // 2
    orders = ArmaxOrders(na=na, nb=len(theta) - na, nc=0, nk=1)
    found = modes(estimates(theta, np.eye(len(theta))), orders, 0.1)

    np.testing.assert_allclose(found.dutch_roll[0, [0, 2]], dutch_roll, rtol=1e-6)
    assert np.isfinite(found.dutch_roll).all() == bool(kinds)
    assert sorted(mode["kind"] for mode in mode_list(found)) == kinds


def test_levels_need_all_three_limits():
    known = ((2.4, 0.23), (2.4, 0.07), (2.4, 0.01), (0.3, 0.5), (2.4, -0.1))
    assert [dutch_roll_level(*each) for each in known] == [1, 2, 3, None, None]


TS, N = 0.25, 41
K = np.arange(6, 6 + N)
"""Whole seconds are the samples 8, 12, 16 and so on."""


def drifting() -> EstimateBlock:
    """Estimates of a yaw channel with servo whose frequency grows sample by sample.

    The estimator warms up for three samples, and once more from row 30 on.
    """
    thetas = []
    for wn in np.linspace(2.0, 3.0, N):
        pole = np.polymul([1.0, 0.6 * wn, wn**2], [0.2, 1.0])
        thetas.append(sampled(wn**2 * np.array([0.8, 1.0]), pole, TS))
    theta = np.array(thetas)
    theta[:3] = 0.0
    is_warm = (np.arange(N) >= 3) & (np.arange(N) < 30)
    return estimates(theta, 1e-8 * np.eye(6), np.where(is_warm, Status.TRACKING, 0))


def part(block: EstimateBlock, rows: slice) -> EstimateBlock:
    return EstimateBlock(block.rows[rows], block.p)


def test_the_yaw_channel_stands_from_one_whole_second_to_the_next():
    estimates = drifting()
    found = PhysicsStage(ORDERS, TS).of(K, estimates)

    for row in range(N):
        second = row - (K[row] % 4)  # the row of the last whole second
        if second < 3 or row >= 30:  # before the run, or warming up
            assert np.isnan(found.yaw[row]).all()
            continue
        rows = slice(second, second + 1)
        [(values, std)], _ = with_sigma(
            estimates.theta[rows], estimates.covariance[rows], ORDERS, TS
        )
        np.testing.assert_array_equal(found.yaw[row], values)
        np.testing.assert_array_equal(found.yaw_std[row], std)
    omega = found.yaw[:, list(YAW_CHANNEL).index("omega_beta")]
    assert omega[29] > omega[10]
    assert (found.yaw_std[29] > 0.0).all()


@pytest.mark.parametrize("na", [3, 6])
def test_a_rows_bits_do_not_depend_on_the_block_it_came_in(na):
    """A block so long that NumPy works in place on its temporaries; NaN has a sign, too."""
    rng, orders, k = np.random.default_rng(9), ArmaxOrders(na, na, 0, 1), np.arange(3000)
    theta, root = rng.standard_normal((3000, 2 * na)), rng.standard_normal((2 * na, 2 * na))
    theta[:8], theta[20] = 0.0, np.nan
    block = estimates(0.4 * theta, 1e-6 * root @ root.T, Status.TRACKING)
    whole = PhysicsStage(orders, 1.0).of(k, block)

    assert np.isfinite(whole.yaw).any()
    for row in [*range(30), *range(30, 3000, 30)]:
        one = slice(row, row + 1)
        found = PhysicsStage(orders, 1.0).of(k[one], part(block, one))
        for name in whole.__slots__:
            assert getattr(found, name).tobytes() == getattr(whole, name)[one].tobytes(), name
