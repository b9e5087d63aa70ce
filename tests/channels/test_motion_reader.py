"""The lateral motion: values and times as sent, the same for every cut of the stream."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from drawn import examples
from flightlog import FlightLog, samples_of
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from yawid.blocks import MotionBlock
from yawid.channels.stage import WANTED, Channels
from yawid.config.run import RunConfig
from yawid.sources.mavlink.decoder import Decoder

LATERAL = RunConfig(lateral="auto")
SIGNALS = {"roll": 0.3, "pitch": 0.05, "p": 0.7, "q": 0.2, "r": 0.4}
"""Amplitudes of sines of 1, 2, 3 ... rad/s, in the order of an attitude's columns."""


def signals(t: float) -> list[float]:
    return [a * np.sin((i + 1) * t) for i, a in enumerate(SIGNALS.values())]


def flown(seconds: float = 12.0, start_s: float = 10.0, *, quaternion: bool = False) -> FlightLog:
    """Return a flight with attitude and RAW_IMU at 25 Hz and servos in between, at 50 Hz."""
    log = FlightLog()
    log.heartbeat(start_s)
    for k in range(round(50 * seconds)):
        t = start_s + 0.02 * k
        if k % 2 == 0:
            log.add(t, attitude(t, quaternion=quaternion))
            ay = round(100 * np.sin(t))
            imu = mavlink.MAVLink_raw_imu_message(
                round(1e6 * (t - 0.003)), 0, ay, -1000, 0, 0, 0, 0, 0, 0
            )
            log.add(t, imu)
        log.servos(t + 0.007, [1500 + k % 300, 1500, 1500, 1500 - k % 200])
    return log


def attitude(t: float, *, quaternion: bool = False) -> object:
    roll, pitch, p, q, r = signals(t)
    ms = round(1000 * t)
    if not quaternion:
        return mavlink.MAVLink_attitude_message(ms, roll, pitch, 0.0, p, q, r)
    (sa, ca), (sb, cb) = ((np.sin(x / 2), np.cos(x / 2)) for x in (roll, pitch))
    turn = ca * cb, sa * cb, ca * sb, -sa * sb  # pitch, then roll; yaw is 0
    return mavlink.MAVLink_attitude_quaternion_message(ms, *turn, p, q, r)


def motion_of(data: bytes, config: RunConfig = LATERAL, cuts: Sequence[int] = ()) -> MotionBlock:
    decoder, channels = Decoder(WANTED), Channels(config)
    pieces = [data[low:high] for low, high in pairwise([0, *sorted(cuts), len(data)])]
    found = []
    for frames in (*map(decoder.feed, pieces), decoder.finish()):
        if frames is not None:
            channels.feed_frames(frames)
        found.append(channels.motion())
    channels.finish()
    return MotionBlock.joined([each for each in (*found, channels.motion()) if each is not None])


@pytest.mark.parametrize("quaternion", [False, True])
def test_attitudes_have_what_was_sent_at_their_own_times(quaternion: bool):
    attitude = motion_of(flown(quaternion=quaternion).data).attitude

    expected = np.array([signals(t / 1e6) for t in attitude.t_us])
    assert np.array_equal(np.diff(attitude.t_us), np.full(len(attitude) - 1, 40_000))
    assert len(attitude) == pytest.approx(300, abs=2)
    assert np.abs(attitude.values - expected).max() < 1e-6
    assert np.all(np.diff(attitude.unix_ns) == 40_000_000)


def test_commands_have_rudder_and_aileron_at_the_servo_message_s_own_times():
    commands = motion_of(flown().data).commands

    k = np.rint((commands.t_us / 1e6 - 10.007) / 0.02).astype(int)
    assert np.all(commands.t_us % 20_000 == 7_000)
    # Stock ArduPilot channels: servo 4 and servo 1, 400 us of half travel.
    assert np.allclose(commands.values[:, 0], -(k % 200) / 400)
    assert np.allclose(commands.values[:, 1], (k % 300) / 400)
    assert np.all(commands.values[:, 2] == 0.0)


def test_rudder_commands_have_the_sign_and_the_unit_asked_for():
    config = replace(LATERAL, rudder_sign="nose-left", rudder_max_deg=20.0)
    turned, plain = (motion_of(flown().data, each).commands for each in (config, LATERAL))

    assert np.allclose(turned.values[:, 0], -np.deg2rad(20.0) * plain.values[:, 0])
    assert np.array_equal(turned.values[:, 1], plain.values[:, 1])


def test_accelerations_are_in_si_at_the_sensor_s_own_times():
    motion = motion_of(flown().data)

    ay, next_us = motion.acceleration.values.T
    t_us = motion.acceleration.t_us
    assert len(t_us) > 290
    assert np.all(t_us % 40_000 == 37_000)
    expected = 9.80665e-3 * np.rint(100 * np.sin(t_us / 1e6 + 0.003))
    assert np.allclose(ay, expected)
    assert np.all(next_us - t_us == 43_000)  # received after the attitude of the same instant


def test_without_the_option_there_is_no_motion_and_samples_are_the_same():
    data = flown().data
    off, on = (samples_of(data, config) for config in (RunConfig(), LATERAL))

    decoder, channels = Decoder(WANTED), Channels(RunConfig())
    for frames in (decoder.feed(data), decoder.finish()):
        if frames is not None:
            channels.feed_frames(frames)
    assert channels.motion() is None
    assert len(off.blocks) == len(on.blocks)
    for a, b in zip(off.blocks, on.blocks, strict=True):
        for name in a.__slots__:
            assert np.array_equal(getattr(a, name), getattr(b, name), equal_nan=True), name


def test_rows_before_from_and_after_to_are_left_out_but_for_a_second():
    config = replace(LATERAL, from_s=14.0, to_s=16.0)

    attitude = motion_of(flown().data, config).attitude

    assert (attitude.t_us[0], attitude.t_us[-1]) == (13_000_000, 17_000_000)


REBOOTED = flown(8.0).data + flown(8.0, start_s=2.0).data


@cache
def whole() -> MotionBlock:
    return motion_of(REBOOTED)


@examples(8)
@given(cuts=st.lists(st.integers(1, len(REBOOTED) - 1), max_size=12, unique=True))
def test_the_motion_does_not_depend_on_the_cut(cuts: list[int]):
    found = motion_of(REBOOTED, cuts=cuts)

    for name in ("attitude", "commands", "acceleration"):
        one, two = getattr(found, name), getattr(whole(), name)
        for column in one.__slots__:
            assert np.array_equal(getattr(one, column), getattr(two, column)), (name, column)
