"""Makes long logs quickly: NumPy packs MAVLink 1 frames of ATTITUDE and SERVO_OUTPUT_RAW."""

from __future__ import annotations

from typing import Any

import numpy as np
from flightlog import START_US, FlightLog
from numpy.typing import NDArray
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from yawid.sources.mavlink.crc import crc_of_frames

Floats = NDArray[np.float64]
_HEADER = [("magic", "u1"), ("length", "u1"), ("seq", "u1"), ("ids", "u1", 2), ("message", "u1")]
_ATTITUDE = [("boot_ms", "<u4"), ("angles", "<f4", 3), ("rates", "<f4", 3)]
_SERVOS = [("usec", "<u4"), ("pwm", "<u2", 8), ("port", "u1")]
_KINDS: dict[str, tuple[Any, list[Any]]] = {
    "ATTITUDE": (mavlink.MAVLink_attitude_message, _ATTITUDE),
    "SERVO_OUTPUT_RAW": (mavlink.MAVLink_servo_output_raw_message, _SERVOS),
}


def _records(name: str, t_us: NDArray[np.int64], seq: NDArray[np.int64]) -> NDArray[Any]:
    """Return the records of one message (n,), without payload and CRC."""
    message, payload = _KINDS[name]
    kind = np.dtype([("stamp", ">u8"), *_HEADER, *payload, ("crc", "<u2")])
    found = np.zeros(len(t_us), kind)
    found["stamp"] = START_US + t_us + 3000
    found["magic"], found["seq"], found["ids"] = 0xFE, seq % 256, (1, 1)
    found["length"], found["message"] = kind.itemsize - 16, message.id
    return found


def _sealed(name: str, found: NDArray[Any]) -> NDArray[np.uint8]:
    """Return the records as bytes (n, size), with their CRCs."""
    rows = found.view(np.uint8).reshape(len(found), -1)
    begins, extra = np.arange(len(found)) * found.itemsize, _KINDS[name][0].crc_extra
    ends = begins + found.itemsize - 2
    extras = np.full(len(found), extra, np.uint8)
    found["crc"] = crc_of_frames(rows.ravel(), begins + 9, ends, extras)
    return rows


def long_log(rate: Floats, rudder_us: Floats, hz: float, start_s: float = 10.0) -> bytes:
    """Return a plane's log: yaw rate (n,) in rad/s at each instant, rudder (n,) in us after it."""
    t_us = np.round(1e6 * (start_s + np.arange(len(rate)) / hz)).astype(np.int64)
    attitude = _records("ATTITUDE", t_us, 2 * np.arange(len(rate)))
    attitude["boot_ms"], attitude["rates"][:, 2] = t_us // 1000, rate
    servos = _records("SERVO_OUTPUT_RAW", t_us, 2 * np.arange(len(rate)) + 1)
    servos["usec"] = t_us % 2**32
    servos["pwm"], servos["pwm"][:, 3] = 1500, np.round(rudder_us)
    head = FlightLog()
    head.heartbeat(start_s - 0.1)
    parts = [_sealed("ATTITUDE", attitude), _sealed("SERVO_OUTPUT_RAW", servos)]
    return head.data + np.concatenate(parts, axis=1).tobytes()
