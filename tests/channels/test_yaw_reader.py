"""Yaw sources: each against the attitude it was made from."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from flightlog import every, fly, reason_ids, samples_of, summary_of
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from scipy.spatial.transform import Rotation

from yawid.blocks import Held
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


def quaternion(t: float) -> list[float]:
    turn = Rotation.from_euler("ZYX", [RATE * t, PITCH, ROLL])
    return list(turn.as_quat(scalar_first=True))


MESSAGES: dict[str, Any] = {
    "ATTITUDE": lambda t: mavlink.MAVLink_attitude_message(
        round(1000 * (10 + t)), ROLL, PITCH, yaw_at(t), *RATES
    ),
    "ATTITUDE_QUATERNION": lambda t: mavlink.MAVLink_attitude_quaternion_message(
        round(1000 * (10 + t)), *quaternion(t), *RATES
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


def test_an_absurd_rate_is_held_and_hurts_no_other_sample():
    log = fly(lambda t: 1e30 if 5.0 < t < 5.1 else 0.2, lambda t: 1500, 15.0)
    found = samples_of(log.data)

    bad = found.held == Held.YAW_INVALID
    assert 1 <= bad.sum() <= 4
    np.testing.assert_allclose(found.y[~bad], 0.2, atol=1e-6)
