"""Splits a tlog into records, changes them, and joins them again.

A record is (receive stamp in us of Unix time, MAVLink frame). The functions do to a good log what
links, radios and recorders do to logs, for the cases of replay_logs/ and the fault tests.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

Record = tuple[int, bytes]
STAMP_SIZE = 8
CLASSES: dict[str, Any] = {cls.msgname: cls for cls in mavlink.mavlink_map.values()}
"""pymavlink's classes of messages, by name."""


def split(log: bytes) -> list[Record]:
    """Return the records of an intact log; an incomplete last one is left out."""
    found, at = [], 0
    while at + STAMP_SIZE + 8 <= len(log):  # of the shortest frame
        begin = at + STAMP_SIZE
        assert log[begin] in (0xFD, 0xFE), f"no MAVLink frame at byte {begin}"
        end = begin + 8 + log[begin + 1]
        if log[begin] == 0xFD:
            end += 4 + 13 * (log[begin + 2] & 1)
        if end > len(log):
            break
        found.append((int.from_bytes(log[at:begin], "big"), log[begin:end]))
        at = end
    return found


def join(records: Iterable[Record]) -> bytes:
    """Return the log of these records."""
    return b"".join(struct.pack(">Q", stamp) + frame for stamp, frame in records)


def message_id(frame: bytes) -> int:
    """Return the number of a frame's message."""
    return frame[5] if frame[0] == 0xFE else int.from_bytes(frame[7:10], "little")


def messages(records: Iterable[Record], *names: str) -> Iterator[Any]:
    """Return the messages of these names, by default all, by pymavlink's own decoder."""
    decoded = map(mavlink.MAVLink(None).decode, (bytearray(frame) for _, frame in records))
    return (message for message in decoded if message.get_type() in (names or CLASSES))


def message_of(name: str, payload: bytes) -> Any:
    """Return the message with this payload, which is filled with zeros or cut to its size."""
    cls = CLASSES[name]
    size = cls.unpacker.size
    head = struct.pack("<BBBBBBHB", size, 0, 0, 0, 1, 1, cls.id & 0xFFFF, cls.id >> 16)
    body = head + payload.ljust(size, b"\0")[:size]
    crc = mavlink.x25crc(body + bytes([cls.crc_extra])).crc
    return mavlink.MAVLink(None).decode(bytearray(b"\xfd" + body + struct.pack("<H", crc)))


def sender(frame: bytes) -> tuple[int, int]:
    """Return (system id, component id) of a frame."""
    at = 3 if frame[0] == 0xFE else 5
    return frame[at], frame[at + 1]


class Encoder:
    """Packs messages of several senders, each with its own sequence; with a key it signs them."""

    def __init__(self, key: bytes | None = None, dialect: Any = mavlink) -> None:
        self._key, self._dialect = key, dialect
        self._links: dict[tuple[int, int], Any] = {}

    def frame(self, message: Any, ids: tuple[int, int] = (1, 1)) -> bytes:
        """Return the message as the next frame of the sender ``ids``."""
        if (link := self._links.get(ids)) is None:
            self._links[ids] = link = self._dialect.MAVLink(None, *ids)
            if self._key is not None:
                link.signing.secret_key, link.signing.sign_outgoing = self._key, True
                link.signing.link_id, link.signing.timestamp = ids[0], 10_000_000
        frame = bytes(message.pack(link))
        link.seq = (link.seq + 1) % 256
        return frame


def edited(
    records: Sequence[Record],
    *,
    sysid: Any = 1,
    key: Any = None,
    **edits: Callable[[Any], Sequence[Any] | None],
) -> list[Record]:
    """Decode each frame, edit the vehicle's messages by their names, and pack all again.

    The vehicle is system 1, which becomes ``sysid``; ``key`` (32 bytes) signs every frame. An edit
    changes its message, or returns what is sent instead.
    """
    encoder, found = Encoder(key), list[Record]()
    for (stamp, frame), message in zip(records, messages(records), strict=True):
        ids, instead = sender(frame), None
        if ids[0] == 1:
            ids = sysid, ids[1]
            instead = edits.get(message.get_type(), lambda _: None)(message)
        sent = [message] if instead is None else instead
        found += [(stamp, encoder.frame(each, ids)) for each in sent]
    return found


def setting(**fields: int) -> Callable[[Any], None]:
    """Return an edit that gives a message's fields these values."""
    return lambda message: vars(message).update(fields)


def px4_control(time_us: int, roll: float, yaw: float) -> Any:
    """Return PX4's ACTUATOR_CONTROL_TARGET of group 0."""
    return mavlink.MAVLink_actuator_control_target_message(
        time_us, 0, [roll, 0.0, yaw, 0.6, 0.0, 0.0, 0.0, -1.0]
    )


def px4_controls(records: Sequence[Record], **heartbeat: int) -> list[Record]:
    """Make the autopilot a PX4 that sends no parameters, and its controls in place of its outputs.

    ``heartbeat`` has more fields of its HEARTBEAT.
    """

    def servos(message: Any) -> list[Any]:
        roll, yaw = ((p - 1500) / 400.0 for p in (message.servo1_raw, message.servo4_raw))
        return [px4_control(message.time_usec, roll, yaw)]

    beat = setting(autopilot=mavlink.MAV_AUTOPILOT_PX4, **heartbeat)
    return edited(records, HEARTBEAT=beat, PARAM_VALUE=lambda _: [], SERVO_OUTPUT_RAW=servos)


def without(records: Sequence[Record], low_s: float, high_s: float) -> list[Record]:
    """Return the records without those received from ``low_s`` to ``high_s`` after the first."""
    low, high = (records[0][0] + round(1e6 * s) for s in (low_s, high_s))
    return [record for record in records if not low <= record[0] < high]


def after(first: Sequence[Record], second: Sequence[Record], pause_s: float) -> list[Record]:
    """Return both logs, the second received ``pause_s`` after the end of the first."""
    shift = first[-1][0] + round(1e6 * pause_s) - second[0][0]
    return [*first, *((stamp + shift, frame) for stamp, frame in second)]


def wrong_crc(frame: bytes) -> bytes:
    """Return a frame as a sender of another dialect packs it: whole, but with a wrong CRC."""
    return frame[:-2] + bytes(b ^ 0x5A for b in frame[-2:])


def nonsense(rng: np.random.Generator) -> bytes:
    """Return bytes that begin like a frame with an unknown message id, followed by noise."""
    size = int(rng.integers(0, 60))
    ident = int(rng.integers(60_000, 2**24)).to_bytes(3, "little")
    head = bytes([0xFD, size, 0, 0, *rng.integers(0, 256, 3).tolist()]) + ident
    return head + rng.bytes(size + 2)
