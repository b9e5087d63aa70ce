"""Yaw sources: each against the attitude it was made from."""

from __future__ import annotations

import math

import numpy as np
import pytest
from flightlog import FlightLog, fly, reason_ids, samples_of, summary_of
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from yawid.blocks import Held
from yawid.channels.yaw_reader import YawReader
from yawid.config.run import RunConfig

RATE = 0.3


def turning(t: float) -> tuple[float, float, float]:
    """Roll, pitch, yaw of a coordinated turn with a heading rate of RATE."""
    return 0.5, 0.1, RATE * t


def body_rates(roll: float, pitch: float) -> tuple[float, float, float]:
    """p, q, r of a turn at a constant roll and pitch (Euler's kinematic equations)."""
    p = -RATE * math.sin(pitch)
    return p, RATE * math.sin(roll) * math.cos(pitch), RATE * math.cos(roll) * math.cos(pitch)


def quaternion(roll: float, pitch: float, yaw: float) -> list[float]:
    cr, sr = math.cos(roll / 2), math.sin(roll / 2)
    cp, sp = math.cos(pitch / 2), math.sin(pitch / 2)
    cy, sy = math.cos(yaw / 2), math.sin(yaw / 2)
    return [
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    ]


def message(name: str, t: float):
    roll, pitch, yaw = turning(t)
    rates = body_rates(roll, pitch)
    yaw = (yaw + math.pi) % (2 * math.pi) - math.pi
    ms, us = round(1000 * (10 + t)), round(1e6 * (10 + t))
    if name == "ATTITUDE":
        return mavlink.MAVLink_attitude_message(ms, roll, pitch, yaw, *rates)
    if name == "ATTITUDE_QUATERNION":
        return mavlink.MAVLink_attitude_quaternion_message(
            ms, *quaternion(roll, pitch, yaw), *rates
        )
    if name == "HIGHRES_IMU":
        return mavlink.MAVLink_highres_imu_message(us, 0, 0, 0, *rates, *([0] * 7), 63)
    milli = [round(1000 * rate) for rate in rates]
    if name == "SCALED_IMU":
        return mavlink.MAVLink_scaled_imu_message(ms, 0, 0, 0, *milli, 0, 0, 0)
    if name == "RAW_IMU":
        return mavlink.MAVLink_raw_imu_message(us, 0, 0, 0, *milli, 0, 0, 0)
    if name == "VFR_HUD":
        heading = int(math.degrees(yaw) % 360.0)
        return mavlink.MAVLink_vfr_hud_message(20.0, 20.0, heading, 50, 100.0, 0.0)
    hdg = round(math.degrees(yaw) % 360.0 * 100)
    return mavlink.MAVLink_global_position_int_message(ms, 0, 0, 0, 0, 0, 0, 0, hdg)


def flight(names: dict[str, float], seconds: float = 20.0) -> FlightLog:
    """Each message from its start time on, at 50 Hz, with a still rudder."""
    log = FlightLog()
    log.heartbeat(10.0)
    for i in range(round(50 * seconds)):
        t = 0.02 * i
        for name, begin in names.items():
            if t >= begin:
                log.add(10 + t, message(name, t))
        log.servos(10 + t + 0.003, [1500] * 4)
    return log


R = body_rates(0.5, 0.1)[2]


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
def test_each_source_gives_the_yaw_rate(name, field, tolerance):
    found = samples_of(flight({name: 0.0}).data)

    assert found.channels.yaw.label == f"{name}.{field}"
    np.testing.assert_allclose(found.y, R, atol=tolerance)


def test_headings_alone_are_no_yaw_rate():
    found = summary_of(flight({"VFR_HUD": 0.0, "GLOBAL_POSITION_INT": 0.0}).data)

    assert "no_yaw" in reason_ids(found)
    assert found["channels"].keys() == {"rudder"}


def test_the_best_source_heard_is_taken_from_its_first_message_on():
    found = samples_of(flight({"SCALED_IMU": 0.0, "ATTITUDE": 8.0}).data)

    assert found.channels.yaw.source == "ATTITUDE"
    assert set(found.epoch) == {0, 1}
    np.testing.assert_allclose(found.y[found.epoch == 1][1:], R, atol=1e-6)


def test_yaw_as_output_is_its_difference_quotient_across_the_wrap():
    found = samples_of(flight({"ATTITUDE": 0.0}, 30.0).data, RunConfig(output="yaw"))

    good = found.held == 0
    assert good.sum() > 500
    assert found.held[0] == Held.GAP
    np.testing.assert_allclose(found.y[good], RATE, atol=1e-4)
    assert found.yaw[-1] - found.yaw[0] > 2 * math.pi


@given(steps=st.lists(st.floats(-3.0, 3.0), min_size=2, max_size=60), cut=st.integers(1, 59))
def test_unwrapping_inverts_the_wrap_and_does_not_see_the_cut(steps, cut):
    true = np.cumsum(steps)
    wrapped = (true + np.pi) % (2.0 * np.pi) - np.pi
    whole, parts = YawReader(), YawReader()

    unwrapped = whole._unwrap(wrapped)
    joined = np.concatenate([parts._unwrap(wrapped[:cut]), parts._unwrap(wrapped[cut:])])

    np.testing.assert_allclose(unwrapped - unwrapped[0], true - true[0], atol=1e-9)
    np.testing.assert_array_equal(joined, unwrapped)


def test_an_absurd_rate_is_held_and_hurts_nobody():
    log = fly(lambda t: 1e30 if 5.0 < t < 5.1 else 0.2, lambda t: 1500, 15.0)
    found = samples_of(log.data)

    bad = found.held == Held.YAW_INVALID
    assert 1 <= bad.sum() <= 4
    np.testing.assert_allclose(found.y[~bad], 0.2, atol=1e-6)
