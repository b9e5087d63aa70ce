"""The vehicle's clock of 32 bits, its leaps, and messages by another clock."""

from __future__ import annotations

import numpy as np
import pytest
from flightlog import beat, every, finished, fly, samples_of
from flights.surgery import join, split
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from yawid.channels.series import unwrap_uint32_us
from yawid.config.run import RunConfig
from yawid.sinks.run_page import origin


@given(
    start=st.integers(0, 40 * 24 * 3600 * 1_000_000),
    steps=st.lists(st.integers(1, 100_000_000), min_size=1, max_size=50),
    skew=st.integers(-30_000_000, 30_000_000),
)
def test_unwrapping_beside_the_full_clock_inverts_the_wrap(start, steps, skew):
    true = start + 60_000_000 + np.cumsum(np.array(steps, np.int64))
    order = np.arange(len(true), dtype=np.int64)

    found = unwrap_uint32_us(true % 2**32, 2 * order + 1, true + skew, 2 * order)

    np.testing.assert_array_equal(found, true)


def still(seconds: float, start_s: float, attitude_s: float = 0.02) -> bytes:
    return fly(lambda t: 0.1, lambda t: 1500, seconds, start_s=start_s, attitude_s=attitude_s).data


def test_the_32_bit_clock_may_wrap_in_flight():
    found = samples_of(still(20.0, 2**32 / 1e6 - 10.0))

    assert len(found) > 380
    assert not found.held.any()
    assert (np.diff(found.k) == 1).all()


@pytest.mark.parametrize(
    ("by_s", "stamps_by_s", "steps", "gaps"),
    [
        (447.0, 0.0, 1, 0),
        (447.0, 447.0, 0, 1),  # a silence of the link
        (40.0, 0.0, 0, 1),
        (-1.4, -1.4, 1, 0),
        (-0.9, -0.9, 0, 0),
    ],
)
def test_a_leap_of_the_vehicle_s_clock_alone_is_reported(by_s, stamps_by_s, steps, gaps):
    after = (
        (stamp + round(1e6 * (stamps_by_s - by_s)), frame)
        for stamp, frame in split(still(20.0, 30.0 + by_s))
    )
    log = still(20.0, 10.0) + join(after)
    summary = finished(log, RunConfig(manoeuvres="off"))

    assert (summary.link.clock_steps, summary.link.gaps, summary.link.reboots) == (steps, gaps, 0)
    link = list(origin(summary))[-1].text
    assert ("the vehicle's clock jumped by 447 s" in link) == (by_s > 400.0 and steps == 1)


def test_a_servo_message_in_unix_time_is_brought_to_the_vehicles_clock():
    def controls(t: float) -> mavlink.MAVLink_message:
        stamp = 1_700_000_000_000_000 + round(1e6 * (10.0 + t))
        moved = [0.0, 0.0, 0.5 if t > 5.0 else 0.0, 0.5, *[0.0] * 4]
        return mavlink.MAVLink_actuator_control_target_message(stamp, 0, moved)

    more = every(0.02, 10.0, controls)
    log = fly(lambda t: 0.1, lambda t: 0, 10.0, servo_s=99.0, vehicle=beat(1, 12), more=more)
    found = samples_of(log.data)

    assert not found.held.any()
    assert abs(found.boot_us[np.argmax(found.u[:, 0] > 0.4)] - 15.0e6) < 0.06e6


def rates_of(log: bytes) -> list[tuple[float, float | None]]:
    summary = finished(log, RunConfig(manoeuvres="off"))
    found = [summary.channels[name] for name in ("yaw", "rudder")]
    return [(each.rate_hz, each.first_rate_hz) for each in found]


def test_a_rate_is_that_of_the_time_in_which_the_channel_flowed():
    late = fly(lambda t: 0.1, lambda t: 1500, 60.0, attitude_s=0.05, servo_s=99.0).data
    late += fly(
        lambda t: 0.1, lambda t: 1500, 20.0, start_s=70.0, attitude_s=0.05, servo_s=0.05
    ).data
    silent = still(8.0, 100.0, 0.1) + still(8.0, 140.0, 0.1) + still(8.0, 20.0, 0.1)
    for log, hz in ((late, (20.0, 20.0)), (silent, (10.0, 50.0))):
        assert rates_of(log) == [(pytest.approx(each), None) for each in hz]


def test_a_rate_that_changes_is_given_with_the_one_that_chose_the_grid():
    log = fly(lambda t: 0.1, lambda t: 1500, 8.0, attitude_s=0.04, servo_s=0.04).data
    log += fly(
        lambda t: 0.1, lambda t: 1500, 60.0, start_s=18.0, attitude_s=0.12, servo_s=0.12
    ).data

    mean = pytest.approx((200 + 500) / 68.0, rel=0.01)
    assert rates_of(log) == [(mean, pytest.approx(25.0, rel=0.01))] * 2
