"""The grid of the contract: y at the instant, u as the mean over the interval that follows."""

from __future__ import annotations

import functools
import math

import numpy as np
import pytest
from flightlog import FlightLog, fly, samples_of
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm

from yawid.blocks import Held
from yawid.config.estimator import ArmaxOrders
from yawid.config.run import RunConfig
from yawid.errors import ConfigError
from yawid.physics.derivatives import yaw_channel

START_S = 10.0


def test_yaw_rate_is_interpolated_to_the_instant():
    log = fly(lambda t: 0.1 * t, lambda t: 1500, 20.0, attitude_s=0.07)
    found = samples_of(log.data, RunConfig(rate=12.5))

    # time_boot_ms is whole milliseconds: 0.1 rad/s^2 * 0.5 ms.
    expected = 0.1 * (found.k * 0.08 - START_S)
    np.testing.assert_allclose(found.y, expected, atol=1e-4)
    np.testing.assert_array_equal(found.boot_us, found.k * 80_000)


def test_the_rudder_is_the_mean_of_the_held_value_over_the_interval_that_follows():
    pwm = {0: 1500, 1: 1600, 2: 1500, 3: 1900}

    def rudder(t: float) -> int:
        return pwm[int(t) % 4]

    log = fly(lambda t: 0.0, rudder, 20.0)
    found = samples_of(log.data, RunConfig(rate=10.0))

    # Servo messages come at 4 ms + n * 20 ms and hold until the next.
    fine = np.arange(0.0, 20.1, 1e-3)
    sent = np.floor((fine - 0.004 + 1e-9) / 0.02) * 0.02 + 0.004
    held = np.array([(rudder(max(t, 0.0)) - 1500) / 400 for t in sent])
    for k, u in zip(found.k, found.u[:, 0], strict=True):
        first = round((k * 0.1 - START_S) * 1000)
        assert u == pytest.approx(held[first : first + 100].mean(), abs=1e-9)


def test_a_rudder_that_steps_within_a_sample_is_marked_and_one_that_steps_at_an_instant_is_not():
    # Servo messages come at 10 s + n * 20 ms: at 13 s, an instant, and at 15.04 s, between two.
    log = fly(lambda t: 0.0, lambda t: 1500 + 99 * (t > 3.0) + 99 * (t > 5.03), 9.0, start_s=9.996)
    found = samples_of(log.data, RunConfig(rate=20.0))

    assert (found.boot_us[found.rudder_moves == 1.0] / 1e6).tolist() == [15.0]
    assert set(found.rudder_moves.tolist()) == {0.0, 1.0}


def test_a_gap_is_a_break_and_never_filled():
    log = fly(lambda t: t, lambda t: 1500, 20.0, skip=lambda t: 7.0 < t < 8.0)
    found = samples_of(log.data)

    held = np.flatnonzero(found.held)
    assert found.held[held].tolist() == [Held.GAP]
    assert found.k[held[0] + 1] - found.k[held[0]] == pytest.approx(20, abs=2)
    assert np.isnan(found.y[held]).all()
    assert found.channels.aligner.gaps == 1


def test_one_lost_message_is_no_gap():
    lost = {5.0, 9.0, 13.0}
    log = fly(lambda t: t, lambda t: 1500, 20.0, skip=lambda t: round(t, 3) in lost)
    found = samples_of(log.data)

    assert not found.held.any()


def test_a_rudder_that_is_off_makes_held_samples():
    log = fly(lambda t: t, lambda t: 0 if t < 6.0 else 1600, 20.0)
    found = samples_of(log.data)

    off = found.held == Held.RUDDER_INVALID
    assert off.sum() == pytest.approx(120, abs=2)
    assert np.isfinite(found.u[~off]).all()


@pytest.mark.parametrize(("attitude_s", "servo_s", "rate"), [(0.1, 0.2, 5.0), (0.02, 0.02, 20.0)])
def test_the_default_rate_is_20_hz_or_the_slower_channels(attitude_s, servo_s, rate):
    log = fly(lambda t: t, lambda t: 1500, 20.0, attitude_s=attitude_s, servo_s=servo_s)
    found = samples_of(log.data)

    assert 1.0 / found.blocks[0].sample_time_s == pytest.approx(rate)


def test_a_rate_above_the_logs_own_is_refused_with_the_achievable_one():
    log = fly(lambda t: t, lambda t: 1500, 20.0, attitude_s=0.1, servo_s=0.2)

    with pytest.raises(ConfigError, match=r"--rate 5 or less$"):
        samples_of(log.data, RunConfig(rate=10.0))


def test_from_and_to_choose_samples():
    log = fly(lambda t: t, lambda t: 1500, 20.0)
    found = samples_of(log.data, RunConfig(from_s=15.0, to_s=17.0))

    assert found.boot_us.min() == 15_000_000
    assert found.boot_us.max() == 17_000_000


def eventful() -> bytes:
    """A flight with a parameter change, a gap, a reboot and values that are no numbers."""
    first = fly(lambda t: math.sin(t), lambda t: 1500 + int(200 * math.sin(3 * t)), 9.0)
    log = FlightLog(data=first.data)
    log.parameter(19.0, "SERVO4_FUNCTION", 21)
    log.parameter(19.0, "SERVO4_MAX", 2000)
    log.attitude(19.0, math.nan)
    more = fly(
        lambda t: math.cos(t),
        lambda t: 1500 + int(100 * math.sin(5 * t)),
        8.0,
        start_s=19.5,
        skip=lambda t: 3.0 < t < 4.0,
    )
    return log.data + more.data + fly(lambda t: 0.3, lambda t: 0, 3.0, start_s=2.0).data


EVENTFUL = eventful()


@given(cuts=st.lists(st.integers(0, len(EVENTFUL)), max_size=40))
def test_samples_do_not_depend_on_how_the_stream_was_cut(cuts):
    whole, cut = samples_of(EVENTFUL), samples_of(EVENTFUL, cuts=cuts)

    for name in (
        "k",
        "boot_us",
        "unix_ns",
        "received_us",
        "u",
        "y",
        "yaw",
        "roll",
        "held",
        "epoch",
    ):
        np.testing.assert_array_equal(getattr(cut, name), getattr(whole, name), err_msg=name)


def plant_log(switches: list[float], levels: list[int], seconds: float) -> tuple[FlightLog, tuple]:
    """A Dutch roll (wn 2.5, zeta 0.2, K 1, T 0.8: eq. 23 for the rate) driven by held pulses."""
    wn, zeta, gain, lead = 2.5, 0.2, 1.0, 0.8
    a = np.array([[0.0, 1.0], [-(wn**2), -2.0 * zeta * wn]])
    full = np.zeros((3, 3))
    full[:2, :2], full[1, 2] = a, 1.0
    c = gain * wn**2 * np.array([1.0, lead])
    log = FlightLog()
    log.heartbeat(START_S)
    state, now, level = np.zeros(2), 0.0, 1500
    events = sorted(
        [(t, 1, v) for t, v in zip(switches, levels, strict=True)]
        + [(i * 0.02, 0, 0) for i in range(round(seconds / 0.02))]
    )
    transition = functools.cache(lambda dt: expm(full * dt))  # most of the steps are alike
    pulses = {round(t, 6): v for t, v in zip(switches, levels, strict=True)}
    moments = sorted({round(t, 6) for t, _, _ in events})
    for t in moments:
        step = transition(round(t - now, 9))
        state = (step @ np.append(state, (level - 1500) / 400))[:2]
        now, level = t, pulses.get(t, level)
        log.servos(START_S + t, [1500, 1500, 1500, level])
        if abs(t * 50 - round(t * 50)) < 1e-6:
            log.attitude(START_S + t, float(c @ state))
    return log, (wn, zeta, gain, lead)


def least_squares(found, nb: int) -> tuple[float, float, np.ndarray]:
    """The ARX(2, nb, 1) poles by least squares: the answer without an estimator of ours."""
    u, y = found.u[:, 0], found.y
    rows = slice(max(2, nb), None)
    columns = [-y[1:-1], -y[:-2]][:2]
    columns = [-np.roll(y, 1), -np.roll(y, 2)] + [np.roll(u, 1 + i) for i in range(nb)]
    phi = np.stack(columns, axis=1)[rows]
    theta = np.linalg.lstsq(phi, y[rows], rcond=None)[0]
    s = np.log(np.roots([1.0, *theta[:2]]).astype(complex)) * 10.0
    wn = math.sqrt(abs(s[0] * s[1]))
    return wn, -(s[0] + s[1]).real / 2.0 / wn, theta


def test_inputs_that_switch_on_the_grid_give_the_plant_back_exactly():
    rng = np.random.default_rng(5)
    switches = [0.1 * i for i in sorted(rng.choice(np.arange(5, 590), 60, replace=False))]
    levels = rng.integers(1300, 1700, 60).tolist()
    log, (wn, zeta, gain, lead) = plant_log(switches, levels, 60.0)
    found = samples_of(log.data, RunConfig(rate=10.0))

    wn_found, zeta_found, theta = least_squares(found, nb=2)

    # ATTITUDE carries float32: that is what 1e-6 leaves room for.
    assert wn_found == pytest.approx(wn, rel=1e-6)
    assert zeta_found == pytest.approx(zeta, rel=1e-6)
    values, _ = yaw_channel(theta[None], ArmaxOrders(2, 2, 0, 1), 0.1)
    np.testing.assert_allclose(values[0, :4], [gain, lead, wn, zeta], rtol=1e-6)


def test_inputs_that_switch_anywhere_give_wn_and_zeta_within_a_percent():
    rng = np.random.default_rng(6)
    switches = sorted(rng.uniform(0.5, 59.0, 60).round(6).tolist())
    levels = rng.integers(1300, 1700, 60).tolist()
    log, (wn, zeta, gain, lead) = plant_log(switches, levels, 60.0)
    found = samples_of(log.data, RunConfig(rate=10.0))

    wn_found, zeta_found, theta = least_squares(found, nb=3)

    assert wn_found == pytest.approx(wn, rel=0.01)
    assert zeta_found == pytest.approx(zeta, rel=0.01)
    assert theta[2:].sum() / (1 + theta[:2].sum()) == pytest.approx(gain, rel=0.05)
    values, _ = yaw_channel(theta[None], ArmaxOrders(2, 3, 0, 1), 0.1)
    assert values[0, 1] == pytest.approx(lead, rel=0.05)
