"""A trimmed tlog is whole records of the stretch asked for, bytes untouched."""

import struct
from typing import Any

import pytest
import trim_tlog
from flights.surgery import split
from pymavlink.dialects.v20 import ardupilotmega


@pytest.fixture(scope="module")
def log() -> bytes:
    """Ten seconds from boot time 30 s on: attitude and servo at 50 Hz, a heartbeat a second."""
    vehicle = ardupilotmega.MAVLink(None, 1, 1)
    records = []
    for ms in range(30_000, 40_000, 10):
        messages: list[Any] = []
        if ms % 20 == 0:
            messages.append(vehicle.attitude_encode(ms, 0.1, 0.0, 0.0, 0.0, 0.0, 0.0))
        else:
            messages.append(vehicle.servo_output_raw_encode(1000 * ms, 0, *[1500] * 8))
        if ms % 1000 == 0:
            messages.append(vehicle.heartbeat_encode(1, 3, 128, 5, 4))
        records += [struct.pack(">Q", 1000 * ms) + m.pack(vehicle) for m in messages]
    return b"".join(records)


def test_trimming_keeps_whole_records_of_the_window_and_the_messages_named(log: bytes) -> None:
    part = trim_tlog.trim(log + b"torn", 33.0, 36.0, ["ATTITUDE", "HEARTBEAT"])

    records = split(part)
    decoder = ardupilotmega.MAVLink(None)
    kept = [decoder.decode(bytearray(frame)) for _, frame in records]
    boot_ms = [m.time_boot_ms for m in kept if m.get_type() == "ATTITUDE"]
    assert b"".join(struct.pack(">Q", s) + frame for s, frame in records) == part
    assert boot_ms == list(range(33_000, 36_000, 20))
    assert sum(m.get_type() == "HEARTBEAT" for m in kept) == 3
    assert len(kept) == 153
