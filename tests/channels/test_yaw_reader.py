"""Yaw sources, each against the attitude it was made from, and the motion as it was sent."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from flightlog import every, fly, reason_ids, samples_of, summary_of
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from scipy.spatial.transform import Rotation

from yawid.blocks import Held, MotionBlock
from yawid.config.run import RunConfig

RATE, ROLL, PITCH = 0.3, 0.5, 0.1
RATES = (
    -RATE * math.sin(PITCH),
    RATE * math.sin(ROLL) * math.cos(PITCH),
    RATE * math.cos(ROLL) * math.cos(PITCH),
)
"""p, q, r of a coordinated turn at RATE (Euler's kinematic equations)."""
MILLI = [round(1000 * rate) for rate in RATES]


def yaw_at(t: float) -> float:
    return (RATE * t + math.pi) % (2 * math.pi) - math.pi


def turned(yaw: float, pitch: float, roll: float) -> list[float]:
    return list(Rotation.from_euler("ZYX", [yaw, pitch, roll]).as_quat(scalar_first=True))


MESSAGES: dict[str, Any] = {
    "ATTITUDE": lambda t: mavlink.MAVLink_attitude_message(
        round(1000 * (10 + t)), ROLL, PITCH, yaw_at(t), *RATES
    ),
    "ATTITUDE_QUATERNION": lambda t: mavlink.MAVLink_attitude_quaternion_message(
        round(1000 * (10 + t)), *turned(RATE * t, PITCH, ROLL), *RATES
    ),
    "HIGHRES_IMU": lambda t: mavlink.MAVLink_highres_imu_message(
        round(1e6 * (10 + t)), 0, 0, 0, *RATES, *([0] * 7), 63
    ),
    "SCALED_IMU": lambda t: mavlink.MAVLink_scaled_imu_message(
        round(1000 * (10 + t)), 0, 0, 0, *MILLI, 0, 0, 0
    ),
    "RAW_IMU": lambda t: mavlink.MAVLink_raw_imu_message(
        round(1e6 * (10 + t)), 0, 0, 0, *MILLI, 0, 0, 0
    ),
    "VFR_HUD": lambda t: mavlink.MAVLink_vfr_hud_message(
        20.0, 20.0, int(math.degrees(yaw_at(t)) % 360.0), 50, 100.0, 0.0
    ),
    "GLOBAL_POSITION_INT": lambda t: mavlink.MAVLink_global_position_int_message(
        round(1000 * (10 + t)), *[0] * 7, round(math.degrees(yaw_at(t)) % 360.0 * 100)
    ),
}


def flight(names: dict[str, float], seconds: float = 20.0) -> bytes:
    """Each message from its start time on, at 50 Hz, with a still rudder."""
    more = [
        (t, message)
        for name, begin in names.items()
        for t, message in every(0.02, seconds, MESSAGES[name])
        if t >= begin
    ]
    return fly(lambda t: 0.0, lambda t: 1500, seconds, attitude_s=99.0, more=more).data


@pytest.mark.parametrize(
    ("name", "field", "tolerance"),
    [
        ("ATTITUDE", "yawspeed", 1e-6),
        ("ATTITUDE_QUATERNION", "yawspeed", 1e-6),
        ("HIGHRES_IMU", "zgyro", 1e-6),
        ("SCALED_IMU", "zgyro", 5e-4),
        ("RAW_IMU", "zgyro", 5e-4),
    ],
)
def test_each_source_gives_the_yaw_rate(name: str, field: str, tolerance: float):
    found = samples_of(flight({name: 0.0}))

    assert found.channels.yaw.label == f"{name}.{field}"
    np.testing.assert_allclose(found.y, RATES[2], atol=tolerance)
    if "ATTITUDE" in name:
        np.testing.assert_allclose(found.roll, ROLL, atol=1e-6)


def test_headings_alone_are_no_yaw_rate():
    found = summary_of(flight({"VFR_HUD": 0.0, "GLOBAL_POSITION_INT": 0.0}))

    assert "no_yaw" in reason_ids(found)
    assert found["channels"].keys() == {"rudder"}


def test_the_best_source_heard_is_taken_from_its_first_message_on():
    found = samples_of(flight({"SCALED_IMU": 0.0, "ATTITUDE": 8.0}))

    assert found.channels.yaw.source == "ATTITUDE"
    assert set(found.epoch) == {0, 1}
    np.testing.assert_allclose(found.y[found.epoch == 1][1:], RATES[2], atol=1e-6)


@pytest.mark.parametrize("name", ["ATTITUDE", "ATTITUDE_QUATERNION"])
def test_yaw_as_output_is_its_difference_quotient_across_the_wrap(name: str):
    found = samples_of(flight({name: 0.0}, 30.0), RunConfig(output="yaw"))

    good = found.held == 0
    assert good.sum() > 500
    assert found.held[0] == Held.GAP
    np.testing.assert_allclose(found.y[good], RATE, atol=1e-4)
    assert found.yaw[-1] - found.yaw[0] > 2 * math.pi


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
    return mavlink.MAVLink_attitude_quaternion_message(ms, *turned(0.0, pitch, roll), p, q, r)


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

    more = [*attitudes, *accelerations]  # of one instant in this order
    return fly(lambda t: 0.0, outputs, SECONDS, attitude_s=99.0, more=more).data


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
