"""Asking for rates, against a vehicle that answers over a real socket; time is the test's own."""

from __future__ import annotations

import socket
import time
from collections.abc import Iterator

import pytest
from flights.surgery import Encoder
from live_link import received
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from yawid.sources.link.endpoints import Endpoint
from yawid.sources.link.rate_requests import RateRequests
from yawid.sources.link.udp import UdpTap
from yawid.sources.mavlink.signing import SigningKey
from yawid.sources.open_log import ReadOptions

VEHICLE, KEY = (3, 1), bytes(range(32))
ATTITUDE, SERVOS = 30, 36
HEARTBEAT = mavlink.MAVLink_heartbeat_message(1, 3, 0x81, 5, 4, 3)


class Link:
    """A vehicle, and the requests for 50 Hz that are sent to it."""

    def __init__(self, vehicle: socket.socket, tap: UdpTap) -> None:
        self.vehicle, self.tap = vehicle, tap
        self.requests = RateRequests(tap, 50.0)
        self.encoder = Encoder()

    def tick(self, *times_s: float) -> list[str]:
        """Let time go on; return what is said at the last of the times."""
        return [[*self.requests.tick(t, VEHICLE)] for t in times_s][-1]

    def say(self, *messages: object) -> None:
        """The vehicle speaks and the requests hear it."""
        before = self.tap.inbox.received
        for message in messages:
            self.vehicle.send(self.encoder.frame(message, VEHICLE))
        data, patience = b"", time.monotonic() + 60.0
        while self.tap.inbox.received < before + len(messages) and time.monotonic() < patience:
            data += self.tap.read(0.2)
        self.requests.feed(data + self.tap.read(0.0), VEHICLE)

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

    def asked(self) -> list[int]:
        """Return for which messages the vehicle has been asked since, at 50 Hz."""
        parser = mavlink.MAVLink(None)
        sent = [
            each for frame in received(self.vehicle) for each in parser.parse_buffer(frame) or []
        ]
        assert {(m.target_system, m.command, m.param2) for m in sent} <= {(3, 511, 20_000.0)}
        return [int(m.param1) for m in sent]


@pytest.fixture
def link() -> Iterator[Link]:
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle,
        UdpTap(Endpoint("127.0.0.1", 0), may_transmit=True) as tap,
    ):
        vehicle.connect(tap.address)
        vehicle.settimeout(0.0)
        yield Link(vehicle, tap)


def test_both_messages_are_asked_for_one_after_the_other_and_again_after_ten_seconds(
    link: Link,
) -> None:
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
    flows: list[tuple[int, int]], said: str, again: list[int], link: Link
) -> None:
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


def test_a_refusal_is_said_with_its_reason(link: Link) -> None:
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
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as router:
        router.bind(("127.0.0.1", 0))
        router.settimeout(60.0)
        with UdpTap(Endpoint(*router.getsockname(), "udpout"), may_transmit=True) as tap:
            requests = RateRequests(tap) if sysid is None else RateRequests(tap, sysid=sysid)
            requests.tick(0.0, None)
            requests.tick(1.0, VEHICLE)
            parser = mavlink.MAVLink(None)
            sent = [parser.decode(bytearray(router.recv(300))) for _ in range(3)]
    senders = [(m.get_type(), m.get_srcSystem(), m.get_srcComponent()) for m in sent]
    assert senders == [
        ("HEARTBEAT", sysid or 250, 194), ("HEARTBEAT", 3, 194), ("COMMAND_LONG", 3, 194),
    ]  # fmt: skip
    assert {(m.type, m.autopilot) for m in sent[:2]} == {
        (mavlink.MAV_TYPE_ONBOARD_CONTROLLER, mavlink.MAV_AUTOPILOT_INVALID)
    }


def test_with_a_key_an_unsigned_answer_is_none(link: Link) -> None:
    link.requests = RateRequests(link.tap, 50.0, ReadOptions(key=SigningKey(KEY)))
    link.say(HEARTBEAT)
    link.tick(0.0)
    for key in (None, KEY):
        link.encoder = Encoder(key)
        link.answer(0)
        assert ("answer" in link.requests.summary()["ATTITUDE"]) == (key is not None)
