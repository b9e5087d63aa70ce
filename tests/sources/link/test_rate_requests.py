"""Asking for rates, against a vehicle that answers over a real socket; time is the test's own."""

from __future__ import annotations

import socket
import time
from collections.abc import Iterator
from types import SimpleNamespace

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from yawid.sources.link.endpoints import Endpoint
from yawid.sources.link.rate_requests import RateRequests
from yawid.sources.link.udp import UdpTap
from yawid.sources.mavlink.signing import SigningKey
from yawid.sources.open_log import ReadOptions

VEHICLE = (3, 1)


@pytest.fixture
def link() -> Iterator[SimpleNamespace]:
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle,
        UdpTap(Endpoint("127.0.0.1", 0), may_transmit=True) as tap,
    ):
        vehicle.connect(tap.address)
        vehicle.settimeout(0.0)
        requests = RateRequests(tap, 50.0)
        codec = mavlink.MAVLink(None, srcSystem=3, srcComponent=1)
        yield SimpleNamespace(vehicle=vehicle, tap=tap, requests=requests, codec=codec)


KEY = bytes(range(32))


@pytest.fixture
def signed_link(link: SimpleNamespace) -> SimpleNamespace:
    """Requests that have the key, and a vehicle that does not sign yet."""
    link.requests = RateRequests(link.tap, 50.0, ReadOptions(key=SigningKey(KEY)))
    return link


def frames_sent(link: SimpleNamespace) -> list[bytes]:
    """What the vehicle has received."""
    found: list[bytes] = []
    try:
        while True:
            found.append(link.vehicle.recv(2048))
    except BlockingIOError:
        return found


def say(link: SimpleNamespace, *messages: object) -> None:
    """The vehicle speaks and the requests hear it."""
    before = link.tap.inbox.received
    for message in messages:
        link.vehicle.send(message.pack(link.codec))  # type: ignore[attr-defined] # no types in pymavlink
        link.codec.seq = (link.codec.seq + 1) % 256
    data, patience = b"", time.monotonic() + 60.0
    while link.tap.inbox.received < before + len(messages) and time.monotonic() < patience:
        data += link.tap.read(0.2)
    link.requests.feed(data + link.tap.read(0.0), VEHICLE)


def asked(link: SimpleNamespace) -> list[tuple[int, int, float, float]]:
    """What the vehicle has been asked since: (system, command, message, interval in us)."""
    found = []
    parser = mavlink.MAVLink(None)
    while True:
        try:
            data = link.vehicle.recv(2048)
        except BlockingIOError:
            return found
        for message in parser.parse_buffer(data) or []:
            row = message.target_system, message.command, message.param1, message.param2
            found.append(row)


def heartbeat() -> object:
    return mavlink.MAVLink_heartbeat_message(1, 3, 0x81, 5, 4, 3)


def answer(result: int) -> object:
    return mavlink.MAVLink_command_ack_message(511, result)


def flow(link: SimpleNamespace, attitudes: int, servos: int) -> None:
    messages = [mavlink.MAVLink_attitude_message(i, 0, 0, 0, 0, 0, 0) for i in range(attitudes)]
    messages += [mavlink.MAVLink_servo_output_raw_message(i, 0, *[0] * 8) for i in range(servos)]
    say(link, *messages)


def settle(link: SimpleNamespace) -> None:
    """Both questions have been asked and accepted at time 0 and 1."""
    say(link, heartbeat())
    link.requests.tick(0.0, VEHICLE)
    say(link, answer(0))
    link.requests.tick(1.0, VEHICLE)
    say(link, answer(0))


def test_both_messages_are_asked_for_one_after_the_other(link: SimpleNamespace) -> None:
    say(link, heartbeat())
    link.requests.tick(0.0, VEHICLE)
    assert asked(link) == [(3, 511, 30.0, 20000.0)]
    link.requests.tick(0.5, VEHICLE)
    assert asked(link) == []
    say(link, answer(0))
    link.requests.tick(0.6, VEHICLE)
    assert asked(link) == [(3, 511, 36.0, 20000.0)]


@pytest.mark.parametrize("sysid", [250, 7])
def test_it_speaks_as_an_onboard_controller_and_never_as_the_ground_station(sysid: int) -> None:
    """System 255's HEARTBEATs would keep ArduPilot's failsafe from acting."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as router:
        router.bind(("127.0.0.1", 0))
        router.settimeout(60.0)
        to = Endpoint(*router.getsockname(), "udpout")
        with UdpTap(to, may_transmit=True) as tap:
            requests = RateRequests(tap, sysid=sysid) if sysid != 250 else RateRequests(tap)
            requests.tick(0.0, None)
            requests.tick(1.0, VEHICLE)
            parser = mavlink.MAVLink(None)
            sent = [parser.decode(bytearray(router.recv(300))) for _ in range(3)]
    assert [m.get_type() for m in sent] == ["HEARTBEAT", "HEARTBEAT", "COMMAND_LONG"]
    senders = [(m.get_srcSystem(), m.get_srcComponent()) for m in sent]
    assert senders == [(sysid, 194), (3, 194), (3, 194)]
    assert {(m.type, m.autopilot) for m in sent[:2]} == {
        (mavlink.MAV_TYPE_ONBOARD_CONTROLLER, mavlink.MAV_AUTOPILOT_INVALID)
    }


def test_nothing_is_asked_of_nobody(link: SimpleNamespace) -> None:
    link.requests.tick(0.0, None)
    assert asked(link) == []


def test_the_rate_achieved_is_said_beside_the_one_asked_for(link: SimpleNamespace) -> None:
    settle(link)
    flow(link, 250, 50)
    [line] = link.requests.tick(5.0, VEHICLE)
    assert line == "rates: ATTITUDE 50.0, SERVO_OUTPUT_RAW 10.0 Hz of the 50 asked for"
    summary = link.requests.summary()
    assert summary["ATTITUDE"] == {"asked_hz": 50.0, "answer": "accepted", "achieved_hz": 50.0}


def test_a_question_without_an_answer_is_asked_again_after_ten_seconds(
    link: SimpleNamespace,
) -> None:
    say(link, heartbeat())
    link.requests.tick(0.0, VEHICLE)
    link.requests.tick(2.0, VEHICLE)
    asked(link)
    link.requests.tick(9.9, VEHICLE)
    assert asked(link) == []
    link.requests.tick(10.0, VEHICLE)
    assert [row[2] for row in asked(link)] == [30.0]


def test_a_rate_that_somebody_else_sets_back_is_asked_for_again(link: SimpleNamespace) -> None:
    settle(link)
    flow(link, 250, 250)
    link.requests.tick(5.0, VEHICLE)
    flow(link, 20, 250)
    link.requests.tick(10.0, VEHICLE)
    link.requests.tick(11.0, VEHICLE)
    assert [row[2] for row in asked(link)][2:] == [30.0]


def test_what_the_vehicle_cannot_give_is_not_asked_for_again_and_again(
    link: SimpleNamespace,
) -> None:
    settle(link)
    for step in range(1, 6):
        flow(link, 200, 200)  # 40 Hz: 0.8 of a loop rate of 50
        link.requests.tick(5.0 * step, VEHICLE)
    assert len(asked(link)) == 2


def test_a_refusal_is_said_with_its_reason(link: SimpleNamespace) -> None:
    say(link, heartbeat())
    link.requests.tick(0.0, VEHICLE)
    say(link, answer(2))
    [line] = link.requests.tick(0.1, VEHICLE)
    assert "denied" in line
    assert "0.8 of SCHED_LOOP_RATE" in line


def test_with_a_key_each_request_is_signed_now_and_newer_than_the_last(
    signed_link: SimpleNamespace,
) -> None:
    say(signed_link, heartbeat())
    before = int((time.time() - 1_420_070_400) * 100_000)
    signed_link.requests.tick(0.0, VEHICLE)
    signed_link.requests.tick(1.0, VEHICLE)
    signed_link.requests.tick(10.0, VEHICLE)
    sent = frames_sent(signed_link)

    vehicle = mavlink.MAVLink(None)  # it refuses what is unsigned, wrongly signed or replayed
    vehicle.signing.secret_key, vehicle.signing.timestamp = KEY, before - 1
    asked_for = [vehicle.decode(bytearray(frame)).param1 for frame in sent]
    assert asked_for == [30.0, 36.0, 30.0]
    with pytest.raises(mavlink.MAVError, match="signature"):
        vehicle.decode(bytearray(sent[0]))
    stamps = [int.from_bytes(frame[-12:-6], "little") for frame in sent]
    assert before <= stamps[0] < stamps[1] < stamps[2] < before + 60 * 100_000


def test_with_a_key_an_unsigned_answer_is_none(signed_link: SimpleNamespace) -> None:
    say(signed_link, heartbeat())
    signed_link.requests.tick(0.0, VEHICLE)
    say(signed_link, answer(0))
    assert "answer" not in signed_link.requests.summary()["ATTITUDE"]
    signed_link.codec.signing.sign_outgoing = True
    signed_link.codec.signing.secret_key, signed_link.codec.signing.timestamp = KEY, 1
    say(signed_link, answer(0))
    assert signed_link.requests.summary()["ATTITUDE"]["answer"] == "accepted"
