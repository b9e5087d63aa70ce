"""Asking a vehicle for rates; the time is the test's own (over a socket: runs/live)."""

from __future__ import annotations

from typing import Any

import pytest
from flightlog import START_US
from flights.surgery import Encoder, join
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from yawid.sources.link.endpoints import Endpoint
from yawid.sources.link.rate_requests import RateRequests
from yawid.sources.mavlink.signing import SigningKey
from yawid.sources.open_log import ReadOptions

VEHICLE, KEY = (3, 1), bytes(range(32))
ATTITUDE, SERVOS = 30, 36
HEARTBEAT = mavlink.MAVLink_heartbeat_message(1, 3, 0x81, 5, 4, 3)


class Link:
    """A vehicle behind a tap, and the requests for 50 Hz that are sent to it."""

    def __init__(self, kind: str = "udpin", **options: Any) -> None:
        self.endpoint, self.sent = Endpoint("127.0.0.1", 0, kind), list[bytes]()
        self.requests = RateRequests(self, **options)
        self.encoder = Encoder()

    def transmit(self, frame: bytes, sysid: int) -> bool:
        """Send a frame as a tap does; without a vehicle it is for whoever listens."""
        assert sysid in (0, VEHICLE[0])
        self.sent.append(frame)
        return True

    def tick(self, *times_s: float) -> list[str]:
        """Let time go on; return what is said at the last of the times."""
        return [[*self.requests.tick(t, VEHICLE)] for t in times_s][-1]

    def say(self, *messages: object) -> None:
        """The vehicle speaks and the requests hear it."""
        frames = [self.encoder.frame(message, VEHICLE) for message in messages]
        self.requests.feed(join(enumerate(frames, START_US)), VEHICLE)

    def answer(self, result: int) -> None:
        self.say(mavlink.MAVLink_command_ack_message(511, result))

    def settle(self) -> None:
        """Both questions are asked and accepted at time 0 and 1."""
        self.say(HEARTBEAT)
        for t in (0.0, 1.0):
            self.tick(t)
            self.answer(0)

    def flow(self, attitudes: int, servos: int) -> None:
        rows = [mavlink.MAVLink_attitude_message(i, *[0] * 6) for i in range(attitudes)]
        rows += [mavlink.MAVLink_servo_output_raw_message(i, 0, *[0] * 8) for i in range(servos)]
        self.say(*rows)

    def heard(self) -> list[Any]:
        """Return the messages sent to the vehicle since."""
        frames, self.sent = self.sent, []
        return [mavlink.MAVLink(None).decode(bytearray(frame)) for frame in frames]

    def asked(self) -> list[int]:
        """Return for which messages the vehicle has been asked since, at 50 Hz."""
        sent = self.heard()
        assert {(m.target_system, m.command, m.param2) for m in sent} <= {(3, 511, 20_000.0)}
        return [int(m.param1) for m in sent]


def test_both_messages_are_asked_for_one_after_the_other_and_again_after_ten_seconds() -> None:
    link = Link()
    link.requests.tick(0.0, None)
    assert link.asked() == []  # of no vehicle
    link.say(HEARTBEAT)
    for t, asked in ((0.0, [ATTITUDE]), (0.5, []), (2.0, [SERVOS]), (9.9, []), (10.0, [ATTITUDE])):
        link.tick(t)
        assert link.asked() == asked
    link.answer(0)
    link.tick(10.1)
    assert link.asked() == []


@pytest.mark.parametrize(
    ("flows", "said", "again"),
    [
        ([(250, 50)], "rates: ATTITUDE 50.0, SERVO_OUTPUT_RAW 10.0 Hz of the 50 asked for", []),
        # Somebody else has set it back.
        ([(250, 250), (20, 250)], "", [ATTITUDE]),
        # 40 Hz is .8 of a loop rate of 50, and cannot be more.
        ([(200, 200)] * 5, "", []),
    ],
)
def test_a_rate_is_said_next_to_the_one_asked_for_and_asked_for_again_where_it_was_set_back(
    flows: list[tuple[int, int]], said: str, again: list[int]
) -> None:
    link = Link()
    link.settle()
    for step, flow in enumerate(flows, 1):
        link.flow(*flow)
        lines = link.tick(5.0 * step)
    if said:
        assert lines == [said]
        accepted = {"asked_hz": 50.0, "answer": "accepted", "achieved_hz": 50.0}
        assert link.requests.summary()["ATTITUDE"] == accepted
    else:
        link.tick(5.0 * len(flows) + 1.0)
        assert link.asked()[2:] == again


def test_a_refusal_is_said_with_its_reason() -> None:
    link = Link()
    link.say(HEARTBEAT)
    link.tick(0.0)
    link.answer(2)
    [line] = link.tick(0.1)
    assert "denied" in line
    assert "0.8 of SCHED_LOOP_RATE" in line


@pytest.mark.parametrize("sysid", [None, 7])
def test_it_speaks_as_an_onboard_controller_and_never_as_the_ground_station(
    sysid: int | None,
) -> None:
    """System 255's HEARTBEATs would keep ArduPilot's failsafe from acting."""
    link = Link("udpout", **({} if sysid is None else {"sysid": sysid}))
    link.requests.tick(0.0, None)
    link.tick(1.0)
    sent = link.heard()
    senders = [(m.get_type(), m.get_srcSystem(), m.get_srcComponent()) for m in sent]
    assert senders == [
        ("HEARTBEAT", sysid or 250, 194), ("HEARTBEAT", 3, 194), ("COMMAND_LONG", 3, 194),
    ]  # fmt: skip
    assert {(m.type, m.autopilot) for m in sent[:2]} == {
        (mavlink.MAV_TYPE_ONBOARD_CONTROLLER, mavlink.MAV_AUTOPILOT_INVALID)
    }


def test_with_a_key_an_unsigned_answer_is_none() -> None:
    link = Link(read_options=ReadOptions(key=SigningKey(KEY)))
    link.say(HEARTBEAT)
    link.tick(0.0)
    for key in (None, KEY):
        link.encoder = Encoder(key)
        link.answer(0)
        assert ("answer" in link.requests.summary()["ATTITUDE"]) == (key is not None)
