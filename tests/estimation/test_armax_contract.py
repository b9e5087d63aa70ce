"""What RecursiveArmax promises whatever the numbers: cuts, held samples, saving, checks."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from estimation.armax_plants import S1, assert_same_bits, config, joined, simulate
from hypothesis import given
from hypothesis import strategies as st

from yawid import ArmaxOrders, ConfigError, RecursiveArmax, Status, parameter_names

OPTIONS = (
    {},
    {"forgetting_factor": 0.98},
    {"method": "rml", "forgetting_factor": 0.99},
    {"method": "rml", "start_buffer": 150},
    {"residual_lags": 0},
    {"scale_window": 0, "bias": False},
)


def holed(n: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    u, y = simulate(S1, n, seed)
    rng = np.random.default_rng(seed)
    u[rng.integers(0, n, 3)] = np.nan
    y[rng.integers(0, n, 3)] = np.nan
    return u, y


@given(
    options=st.sampled_from(OPTIONS),
    seed=st.integers(0, 1000),
    cuts=st.lists(st.integers(0, 500), max_size=8),
)
def test_block_cuts_never_change_a_bit(options, seed, cuts):
    u, y = holed(500, seed)
    whole = RecursiveArmax(config(**options))
    pieces = RecursiveArmax(config(**options))
    edges = [0, *sorted(cuts), 500]
    parts = [pieces.run(u[a:b], y[a:b], covariance=True) for a, b in pairwise(edges) if b > a]
    assert_same_bits(joined(parts), whole.run(u, y, covariance=True))
    assert pieces.to_bytes() == whole.to_bytes()


def test_an_estimate_is_a_snapshot():
    armax = RecursiveArmax(config())
    u, y = simulate(S1, 300, 0)
    armax.run(u[:200], y[:200])
    e = armax.update(float(u[200]), float(y[200]))
    theta, std, innovation = e.theta.copy(), e.theta_std.copy(), e.innovation
    armax.run(u[201:], y[201:])
    np.testing.assert_array_equal(e.theta, theta)
    np.testing.assert_array_equal(e.theta_std, std)
    assert e.innovation == innovation


def test_bytes_of_another_version_or_none_at_all_are_refused():
    saved = RecursiveArmax(config()).to_bytes()
    with pytest.raises(ConfigError, match="yawid-armax-0"):
        RecursiveArmax.from_bytes(saved.replace(b"yawid-armax-4", b"yawid-armax-0"))
    with pytest.raises(ConfigError, match="bytes"):
        RecursiveArmax.from_bytes(saved[:-8])
    for junk in (b"", b"hello", b"[1]\n", b"{}\n"):
        with pytest.raises(ConfigError):
            RecursiveArmax.from_bytes(junk)


@pytest.mark.parametrize("options", OPTIONS)
def test_a_held_sample_leaves_theta_and_p_to_the_bit_and_refills_the_lags(options):
    u, y = simulate(S1, 400, 4)
    armax = RecursiveArmax(config(**options))
    armax.run(u[:300], y[:300])
    theta, P, updates = armax.theta, armax.P, armax.updates
    assert armax.update(0.5, float("nan")).status == Status.HELD
    assert armax.update(float("nan"), 0.5).status == Status.HELD
    for k in range(4):  # two lags of y and u, then two of the residual
        e = armax.update(float(u[302 + k]), float(y[302 + k]))
        assert e.status == Status.HELD
        np.testing.assert_array_equal(armax.theta, theta)
        np.testing.assert_array_equal(armax.P, P)
    assert armax.updates == updates
    assert armax.update(float(u[306]), float(y[306])).status == Status.TRACKING
    assert armax.updates == updates + 1
    assert armax.updates + armax.held == 307


def test_what_lies_before_a_gap_is_no_neighbour_of_what_follows():
    u, y = simulate(S1, 900, 5)
    armax = RecursiveArmax(config(bias=False))
    armax.run(u[:600], y[:600])
    armax.update(float("nan"), float("nan"))
    armax.run(u[600:602] + 1e6, y[600:602] + 1e6)  # fills the lags, but is never regressed upon
    armax.update(float("nan"), float("nan"))
    after = armax.run(u[602:], y[602:])
    np.testing.assert_allclose(after.theta[-1], [*S1[0], *S1[1], *S1[2]], atol=0.3)
    assert np.nanmax(np.abs(after.innovation)) < 10.0


def test_the_window_holds_updates_back_until_every_channel_moves():
    u, y = simulate(S1, 600, 6)
    armax = RecursiveArmax(config())
    still = armax.run(np.full(250, 0.3), y[:250])
    assert (still.status == Status.WARMING_UP).all()
    assert not still.theta.any()
    assert np.isnan(still.y_hat).all()
    assert armax.updates == 0
    moving = armax.run(u, y)
    first = int(np.flatnonzero(moving.theta.any(axis=1))[0])
    assert first == 0  # one sample that moves, among a hundred, is a spread
    assert armax.updates + armax.held == 850
    assert moving.status[-1] == Status.TRACKING


def test_held_samples_in_the_window_break_it_but_lose_no_others():
    u, y = simulate(S1, 130, 7)
    gapped = np.insert(u, [10, 60], np.nan), np.insert(y, [10, 60], np.nan)
    armax = RecursiveArmax(config())
    armax.run(*gapped)
    lags = 4
    assert armax.updates == 130 - 3 * lags
    assert armax.held == 2 + 3 * lags


def test_scales_change_nothing_but_the_prior():
    u, y = simulate(S1, 3000, 8)
    plain = RecursiveArmax(config(method="rml")).run(u, y, keep="last").theta[0]
    scaled = RecursiveArmax(config(method="rml")).run(u * 1024.0, y * 64.0, keep="last").theta[0]
    units = np.array([1, 1, 1 / 16, 1 / 16, 1, 1, 64])
    np.testing.assert_array_equal(scaled, plain * units)


def test_inputs_that_do_not_fit_are_named():
    one = RecursiveArmax(config())
    two = RecursiveArmax(config(ArmaxOrders(1, (1, 1), 0, (1, 1))))
    with pytest.raises(ValueError, match=r"u must have shape \(3, 1\)"):
        one.run(np.zeros((3, 2)), np.zeros(3))
    with pytest.raises(ValueError, match=r"y must have shape"):
        one.run(np.zeros(3), np.zeros((3, 1)))
    with pytest.raises(ValueError, match=r"u must have shape \(3, 2\)"):
        two.run(np.zeros(3), np.zeros(3))
    with pytest.raises(ValueError, match=r"u must have shape \(1, 2\)"):
        two.update(1.0, 1.0)
    with pytest.raises(ValueError, match="keep"):
        one.run(np.zeros(3), np.zeros(3), keep="some")
    with pytest.raises(ValueError, match="infinite"):
        one.run([0.0, -np.inf], [0.0, 0.0])


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"forgetting_factor": 0.0}, r"forgetting_factor must lie in \(0, 1\], got 0.0"),
        ({"forgetting_factor": 1.01}, r"forgetting_factor must lie in \(0, 1\], got 1.01"),
        ({"forgetting_factor": float("nan")}, "forgetting_factor"),
        ({"P0": -1.0}, "P0 must be > 0 and finite, got -1.0"),
        ({"method": "lms"}, "method"),
        ({"sample_time_s": 0.0}, "sample_time_s"),
        ({"scale_window": -1}, "scale_window"),
        ({"start_buffer": 1.5}, "start_buffer"),
        ({"residual_lags": -1}, "residual_lags"),
        ({"scale_minimum": -1.0}, "scale_minimum"),
        ({"information_floor": -0.1}, "information_floor"),
        ({"orders": (2, 2, 2, 1)}, "ArmaxOrders"),
    ],
)
def test_a_setting_outside_its_limits_is_named(options, words):
    with pytest.raises(ConfigError, match=words):
        replace(config(), **options)


def test_orders_of_zero_everywhere_are_refused():
    with pytest.raises(ConfigError, match="zero everywhere"):
        ArmaxOrders(0, 0, 0, 1)


def test_parameters_are_named_in_theta_order():
    orders = ArmaxOrders(2, (1, 2), 1, (1, 1))
    names = parameter_names(orders, ("rudder", "aileron"), bias=True)
    assert names == ("a1", "a2", "b1", "b1_aileron", "b2_aileron", "c1", "bias")
    with pytest.raises(ValueError, match="1 input names"):
        parameter_names(orders)


def test_the_places_in_a_save_are_those_of_its_version() -> None:
    """Nothing is reckoned yet, so these are the same bytes on every machine."""
    orders = ArmaxOrders(2, (2, 1), 2, (1, 3))
    made = config(orders, method="rml", forgetting_factor=0.98, start_buffer=60)
    digest = hashlib.sha256(RecursiveArmax(made).to_bytes()).hexdigest()
    assert digest.startswith("fd81ede50d72f"), "another layout needs another VERSION"
