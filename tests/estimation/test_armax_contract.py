"""What RecursiveArmax promises whatever the numbers: gaps, the window, saving, settings."""

from __future__ import annotations

import hashlib
from dataclasses import replace

import numpy as np
import pytest
from estimation.armax_plants import S1, config, simulate

from yawid import ArmaxOrders, ConfigError, RecursiveArmax, Status, parameter_names


def test_bytes_of_another_version_or_none_at_all_are_refused():
    saved = RecursiveArmax(config()).to_bytes()
    for junk, words in (
        (saved.replace(b"yawid-armax-4", b"yawid-armax-0"), "yawid-armax-0"),
        (saved[:-8], "bytes"),
        *((each, None) for each in (b"", b"hello", b"[1]\n", b"{}\n")),
    ):
        with pytest.raises(ConfigError, match=words):
            RecursiveArmax.from_bytes(junk)


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
    assert moving.theta[0].any()  # one sample that moves, among a hundred, is a spread
    assert armax.updates + armax.held == 850
    assert moving.status[-1] == Status.TRACKING


def test_held_samples_in_the_window_break_it_but_lose_no_others():
    u, y = simulate(S1, 130, 7)
    armax = RecursiveArmax(config())
    armax.run(np.insert(u, [10, 60], np.nan), np.insert(y, [10, 60], np.nan))
    lags = 4
    assert (armax.updates, armax.held) == (130 - 3 * lags, 2 + 3 * lags)


def test_scales_change_nothing_but_the_prior():
    u, y = simulate(S1, 3000, 8)
    plain = RecursiveArmax(config(method="rml")).run(u, y, keep="last").theta[0]
    scaled = RecursiveArmax(config(method="rml")).run(u * 1024.0, y * 64.0, keep="last").theta[0]
    units = np.array([1, 1, 1 / 16, 1 / 16, 1, 1, 64])
    np.testing.assert_array_equal(scaled, plain * units)


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
