from __future__ import annotations

import struct

import numpy as np
import pytest
from flightlog import FlightLog, finished, fly, samples_of, summary_of
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from yawid.blocks import Held
from yawid.channels.series import unwrap_uint32_us
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


def still(t: float) -> float:
    return 0.1


def centred(t: float) -> int:
    return 1500


def test_the_32_bit_clock_may_wrap_in_flight():
    log = fly(still, centred, 20.0, start_s=2**32 / 1e6 - 10.0)

    found = samples_of(log.data)

    assert len(found) > 380
    assert not found.held.any()
    assert (np.diff(found.k) == 1).all()


def test_a_reboot_ends_the_segment_with_one_held_sample():
    log = fly(still, centred, 20.0, start_s=300.0)
    second = fly(still, centred, 20.0, start_s=12.0)

    found = samples_of(log.data + second.data)

    assert found.channels.segmenter.reboots == 1
    assert found.held.tolist().count(int(Held.REBOOT)) == 1
    assert (found.held != 0).sum() == 1
    assert (np.diff(found.unix_ns) >= 0).all()


def test_a_small_step_back_is_no_reboot():
    log = fly(still, centred, 20.0, start_s=300.0)
    second = fly(still, centred, 20.0, start_s=317.5)

    found = samples_of(log.data + second.data)

    segmenter = found.channels.segmenter
    assert (segmenter.reboots, segmenter.clock_steps) == (0, 1)


def leaping(by_s: float, *, stamps_too: bool) -> bytes:
    """Return a flight whose clock goes on by so much in the middle, and the stamps or not."""
    log, second = fly(still, centred, 20.0), fly(still, centred, 20.0, start_s=30.0 + by_s)
    if stamps_too:
        return log.data + second.data
    shifted, at = bytearray(second.data), 0
    for size in record_sizes(second.data):
        stamp = struct.unpack_from(">Q", shifted, at)[0] - round(1e6 * by_s)
        struct.pack_into(">Q", shifted, at, stamp)
        at += size
    return log.data + bytes(shifted)


def record_sizes(data: bytes) -> list[int]:
    """Return the lengths of the records of MAVLink 2, unsigned, from their headers."""
    sizes, at = [], 0
    while at < len(data):
        sizes.append(8 + 12 + data[at + 9])
        at += sizes[-1]
    return sizes


def test_a_clock_that_leaps_by_minutes_while_the_stamps_do_not_is_reported():
    summary = finished(leaping(447.0, stamps_too=False))

    assert summary.link.clock_steps == 1
    assert summary.link.clock_leap_s == pytest.approx(447.0, abs=0.1)
    link = list(origin(summary))[-1].text
    assert "the vehicle's clock jumped by 447 s" in link
    assert "1 clock step;" in link or "1 clock step," in link


@pytest.mark.parametrize(("by_s", "stamps_too"), [(447.0, True), (40.0, False)])
def test_a_silence_of_the_link_or_a_shorter_step_is_no_leap(by_s: float, stamps_too: bool):
    summary = summary_of(leaping(by_s, stamps_too=stamps_too))

    assert (summary["link"]["clock_steps"], summary["link"]["gaps"]) == (0, 1)
    assert "clock_leap_s" not in summary["link"]


def test_a_leap_is_found_however_the_stream_is_cut():
    data = leaping(447.0, stamps_too=False)
    found = [
        samples_of(data, cuts=cuts).channels.segmenter for cuts in ((), range(0, len(data), 1511))
    ]
    assert [(s.clock_steps, s.leap_us) for s in found] == [(1, found[0].leap_us)] * 2


def test_a_repeated_message_changes_nothing():
    log = fly(still, centred, 20.0)
    twice = FlightLog()
    record = len(fly(still, centred, 0.02).data) - len(fly(still, centred, 0.0).data)
    assert record > 0
    found = samples_of(log.data)
    again = samples_of(log.data[:-record] + log.data[-record:] + log.data[-record:])
    assert twice.data == b""

    np.testing.assert_array_equal(again.y, found.y)
    np.testing.assert_array_equal(again.u, found.u)


def test_a_long_silence_is_one_held_sample_however_long():
    log = fly(still, centred, 4000.0, attitude_s=0.1, servo_s=0.1, skip=lambda t: 20 < t < 3980)

    found = samples_of(log.data)

    assert (found.held != 0).sum() == 1
    assert found.channels.segmenter.silences == 1
    assert len(found) < 450


def test_receive_stamps_in_bursts_leave_unix_time_even():
    log = fly(still, centred, 30.0)
    found = samples_of(log.data)

    steps = np.diff(found.unix_ns) / 1e9
    np.testing.assert_allclose(steps[200:], 0.05, atol=1e-6)


def test_a_servo_message_in_unix_time_is_brought_to_the_vehicles_clock():
    log = FlightLog()
    log.heartbeat(10.0, autopilot=12)
    for i in range(500):
        t = 10.0 + 0.02 * i
        log.attitude(t, 0.1)
        controls = [0.0, 0.0, 0.5 if i > 250 else 0.0, 0.5, 0.0, 0.0, 0.0, 0.0]
        stamp = 1_700_000_000_000_000 + round(1e6 * (t + 0.001))
        log.add(t + 0.001, mavlink.MAVLink_actuator_control_target_message(stamp, 0, controls))
    found = samples_of(log.data)

    assert not found.held.any()
    moved = found.boot_us[np.argmax(found.u[:, 0] > 0.4)]
    assert abs(moved - 15.0e6) < 0.06e6
