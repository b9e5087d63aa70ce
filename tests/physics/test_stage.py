"""Modes and yaw channel of a stream of estimates."""

from __future__ import annotations

from functools import cache
from itertools import pairwise

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import cont2discrete

from yawid.blocks import EstimateBlock, ModesBlock, Status
from yawid.config.estimator import ArmaxOrders
from yawid.physics.derivatives import with_sigma
from yawid.physics.stage import PhysicsStage
from yawid.quantities.table import YAW_CHANNEL

ORDERS = ArmaxOrders(na=3, nb=3, nc=0, nk=1)
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
        b, a, _ = cont2discrete((wn**2 * np.array([0.8, 1.0]), pole), TS)
        thetas.append(np.concatenate([a[1:], np.ravel(b)[1:]]))
    theta = np.array(thetas)
    theta[:3] = 0.0
    covariance = np.broadcast_to(1e-8 * np.eye(6), (N, 6, 6))
    is_warm = (np.arange(N) >= 3) & (np.arange(N) < 30)
    status = np.where(is_warm, Status.TRACKING, Status.WARMING_UP)
    zero = np.zeros(N)
    return EstimateBlock.of(
        theta, theta, covariance, zero, zero, zero, zero, status.astype(np.uint8)
    )


@cache
def drifting_whole() -> tuple[EstimateBlock, ModesBlock]:
    """Return such estimates, and what the physics say of them in one piece."""
    return (estimates := drifting()), PhysicsStage(ORDERS, TS).of(K, estimates)


def part(block: EstimateBlock, rows: slice) -> EstimateBlock:
    return EstimateBlock(block.rows[rows], block.p)


def test_the_yaw_channel_stands_from_one_whole_second_to_the_next():
    estimates, found = drifting_whole()

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


@given(cuts=st.lists(st.integers(1, N - 1), max_size=6, unique=True))
def test_rows_do_not_depend_on_how_the_stream_was_cut(cuts):
    estimates, whole = drifting_whole()
    rows = PhysicsStage(ORDERS, TS)
    edges = [0, *sorted(cuts), N]
    slices = [slice(first, last) for first, last in pairwise(edges)]
    parts = [rows.of(K[s], part(estimates, s)) for s in slices]

    for name in whole.__slots__:
        joined = np.concatenate([getattr(part, name) for part in parts])
        np.testing.assert_array_equal(joined, getattr(whole, name), err_msg=name)
