"""The lateral motion: values and times as sent."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from flightlog import every, fly, samples_of
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from yawid.blocks import MotionBlock
from yawid.config.run import RunConfig

LATERAL = RunConfig(lateral="auto")
SECONDS, START_S = 12.0, 10.0
SIGNALS = {"roll": 0.3, "pitch": 0.05, "p": 0.7, "q": 0.2, "r": 0.4}
"""Amplitudes of sines of 1, 2, 3 ... rad/s, in the order of an attitude's columns."""


def signals(t: float) -> list[float]:
    return [a * math.sin((i + 1) * t) for i, a in enumerate(SIGNALS.values())]


def attitude(t: float, *, quaternion: bool = False) -> Any:
    roll, pitch, p, q, r = signals(t)
    ms = round(1000 * t)
    if not quaternion:
        return mavlink.MAVLink_attitude_message(ms, roll, pitch, 0.0, p, q, r)
    (sa, ca), (sb, cb) = ((math.sin(x / 2), math.cos(x / 2)) for x in (roll, pitch))
    turn = ca * cb, sa * cb, ca * sb, -sa * sb  # pitch, then roll; yaw is 0
    return mavlink.MAVLink_attitude_quaternion_message(ms, *turn, p, q, r)


def imu(t: float) -> Any:
    stamp, ay = round(1e6 * (t - 0.003)), round(100 * math.sin(t))
    return mavlink.MAVLink_raw_imu_message(stamp, 0, ay, -1000, *[0] * 6)


@cache
def flown(quaternion: bool = False) -> bytes:
    """Return a flight with attitude and RAW_IMU at 25 Hz and servos in between, at 50 Hz."""
    attitudes = every(0.04, SECONDS, lambda t: attitude(START_S + t, quaternion=quaternion))
    accelerations = every(0.04, SECONDS, lambda t: imu(START_S + t))

    def outputs(t: float) -> list[int]:
        k = round((t - 0.004) / 0.02)
        return [1500 + k % 300, 1500, 1500, 1500 - k % 200]

    both = [each for pair in zip(attitudes, accelerations, strict=True) for each in pair]
    return fly(lambda t: 0.0, outputs, SECONDS, attitude_s=99.0, more=both).data


@cache
def motion(quaternion: bool = False, config: RunConfig = LATERAL) -> MotionBlock:
    return MotionBlock.joined(samples_of(flown(quaternion), config).motion)


@pytest.mark.parametrize("quaternion", [False, True])
def test_attitudes_have_what_was_sent_at_their_own_times(quaternion: bool):
    attitude = motion(quaternion).attitude

    expected = np.array([signals(t / 1e6) for t in attitude.t_us])
    assert np.array_equal(np.diff(attitude.t_us), np.full(len(attitude) - 1, 40_000))
    assert len(attitude) == pytest.approx(300, abs=2)
    assert np.abs(attitude.values - expected).max() < 1e-6
    assert np.all(np.diff(attitude.unix_ns) == 40_000_000)


def test_commands_have_rudder_and_aileron_at_the_servo_message_s_own_times():
    plain, turned = (
        motion(config=config).commands
        for config in (LATERAL, replace(LATERAL, rudder_sign="nose-left", rudder_max_deg=20.0))
    )

    k = np.rint((plain.t_us / 1e6 - START_S - 0.004) / 0.02).astype(int)
    assert np.all(plain.t_us % 20_000 == 4_000)
    # Stock ArduPilot channels: servo 4 and servo 1, 400 us of half travel.
    assert np.allclose(plain.values[:, 0], -(k % 200) / 400)
    assert np.allclose(plain.values[:, 1], (k % 300) / 400)
    assert np.all(plain.values[:, 2] == 0.0)
    assert np.allclose(turned.values[:, 0], -np.deg2rad(20.0) * plain.values[:, 0])
    assert np.array_equal(turned.values[:, 1], plain.values[:, 1])


def test_accelerations_are_in_si_at_the_sensor_s_own_times():
    rows = motion().acceleration

    ay, next_us = rows.values.T
    assert len(rows) > 290
    assert np.all(rows.t_us % 40_000 == 37_000)
    expected = 9.80665e-3 * np.rint(100 * np.sin(rows.t_us / 1e6 + 0.003))
    assert np.allclose(ay, expected)
    assert np.all(next_us - rows.t_us == 43_000)  # received after the attitude of the same instant


def test_without_the_option_there_is_no_motion_and_samples_are_the_same():
    off, on = (samples_of(flown(), config) for config in (RunConfig(ordinary="off"), LATERAL))

    assert off.motion == []
    for a, b in zip(off.blocks, on.blocks, strict=True):
        for name in a.__slots__:
            assert np.array_equal(getattr(a, name), getattr(b, name), equal_nan=True), name
