"""Flights whose rudder is not the one that moved the aircraft: none may have a usable answer.

The rudder is that of another flight, its own reversed in time, or its own late. A yaw rate that
decays freely has the right frequency whatever the rudder did, so what is judged is the verdict.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from flights.fly import Made
from flights.moved import CHOSEN, Draw, excited
from flights.surgery import Record, edited, join, message_id, payload, split

APART = 34
"""The number of the other flight is larger by this: another aircraft, and the same air."""
LATE_S = 0.4
"""The time by which a late clock is late, in s."""


def pulses(flown: list[Record]) -> list[tuple[int, int]]:
    """Return the stamp in us and the rudder's pulse of each SERVO_OUTPUT_RAW."""
    servos = mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW
    frames = (frame for _, frame in flown if message_id(frame) == servos)
    found = (struct.unpack("<I4H", payload(frame, 12)) for frame in frames)
    return [(time_us, rudder) for time_us, *_, rudder in found]


def with_pulses(flown: list[Record], rudder: list[int]) -> bytes:
    """Return the log with these pulses of the rudder, one for each SERVO_OUTPUT_RAW."""
    left = iter(rudder)

    def servos(message: Any) -> None:
        message.servo4_raw = next(left)

    return join(edited(flown, SERVO_OUTPUT_RAW=servos))


def other(number: int, draw: Draw) -> Made:
    """Give a flight the rudder of another one, at the times of its own messages."""
    made, stranger = excited(number, draw), pulses(split(excited(number + APART, draw).log))
    flown = split(made.log)
    rudder, at = [], 0
    for stamp, _ in pulses(flown):
        while at + 1 < len(stranger) and stranger[at + 1][0] <= stamp:
            at += 1
        rudder.append(stranger[at][1])
    return Made(with_pulses(flown, rudder), made.truth)


def backwards(number: int, draw: Draw) -> Made:
    """Reverse a flight's rudder in time."""
    made = excited(number, draw)
    flown = split(made.log)
    return Made(with_pulses(flown, [pulse for _, pulse in reversed(pulses(flown))]), made.truth)


def late(number: int, draw: Draw) -> Made:
    """Give a flight's rudder a clock that is late."""
    made = excited(number, draw)
    flown = split(made.log)
    own = pulses(flown)
    behind = sum(stamp < own[0][0] + 1e6 * LATE_S for stamp, _ in own)
    rudder = [own[0][1]] * behind + [pulse for _, pulse in own[: len(own) - behind]]
    return Made(with_pulses(flown, rudder), made.truth)


KINDS: dict[str, Callable[[int, Draw], Made]] = {
    "other flight": other,
    "backwards": backwards,
    "late": late,
}


def misled(number: int, draw: Draw = CHOSEN) -> Made:
    """Return log ``number`` of the corpus; the kinds come in turn, and so do the flights."""
    kind = list(KINDS)[number % len(KINDS)]
    made = KINDS[kind](number // len(KINDS), draw)
    assert made.truth is not None
    return Made(made.log, made.truth | {"group": kind})
