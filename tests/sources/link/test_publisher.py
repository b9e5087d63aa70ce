"""What is published: decoded by pymavlink as a ground station does, and never more than may be."""

from __future__ import annotations

import math
import socket
from contextlib import ExitStack
from itertools import pairwise
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from live_link import received
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from yawid.errors import ConfigError
from yawid.sources.link.endpoints import Endpoint, parse_endpoint
from yawid.sources.link.publisher import (
    INFO,
    MOST_WAITING,
    NOTICE,
    Limiter,
    OverUdp,
    Publisher,
    parse_publish,
)
from yawid.sources.link.tcp_serial import StreamTap
from yawid.sources.mavlink.signing import SigningKey

KEY = bytes(range(32))
VALUES = {
    "yaw_wn": 10.06, "yaw_wn_sd": 0.28, "yaw_zeta": 0.646, "yaw_z_sd": 0.042, "yaw_ok": 1.0,
}  # fmt: skip


class Noted:
    """A way that keeps what goes, with the time that the test gives."""

    def __init__(self) -> None:
        self.now_s = 0.0
        self.sent: list[tuple[float, bytes]] = []

    def __call__(self, frame: bytes, sysid: int) -> None:
        assert sysid == (frame[5])
        self.sent.append((self.now_s, frame))

    def messages(self) -> list[Any]:
        parser = mavlink.MAVLink(None)
        return [message for _, frame in self.sent for message in parser.parse_buffer(frame)]


STEPS = st.lists(
    st.tuples(
        st.sampled_from([0.0, 0.01, 0.3, 1.0, 2.5, 9.9, 10.0]),
        st.sampled_from(["round", "note", "verdict"]),
        st.integers(1, 3),
        st.integers(0, 60),
    ),
    min_size=1,
    max_size=150,
)


@given(STEPS, st.booleans())
def test_no_ten_seconds_have_more_bytes_than_may_be_and_every_verdict_arrives(
    steps: list[tuple[float, str, int, int]], signed: bool
) -> None:
    way, most = Noted(), 3500 if signed else 2500
    publisher = Publisher({"there": way}, 194, SigningKey(KEY) if signed else None)
    verdicts: dict[int, str] = {}
    for number, (pause_s, what, sysid, size) in enumerate(steps):
        way.now_s += pause_s
        if what == "round":
            publisher.send_round(sysid, 0, VALUES, way.now_s)
        elif what == "note":
            publisher.say(sysid, INFO, f"{number} " + size * "x")
        else:
            verdicts[sysid] = f"verdict {number}"
            publisher.say(sysid, NOTICE, verdicts[sysid], about="verdict")
        publisher.send_texts(way.now_s)
    for _ in range(60):  # nothing waits forever, though rounds go on
        way.now_s += 1.0
        publisher.send_round(1, 0, VALUES, way.now_s)
        publisher.send_texts(way.now_s)

    for at, (begin_s, _) in enumerate(way.sent):
        within = (f for t, f in way.sent[at:] if t - begin_s <= 10.0)
        assert sum(map(len, within)) <= most
    texts = [m for m in way.messages() if m.get_type() == "STATUSTEXT"]
    for sysid, told in verdicts.items():
        own = [m.text for m in texts if m.get_srcSystem() == sysid and "verdict" in m.text]
        assert own[-1] == told
    assert all(len(m.text) <= 50 for m in texts)
    in_order: dict[int, list[int]] = {}
    for _, frame in way.sent:
        in_order.setdefault(frame[5], []).append(frame[4])
    for numbers in in_order.values():  # of each system, without a gap
        assert all((b - a) % 256 == 1 for a, b in pairwise(numbers))


def test_what_was_sent_counts_for_ten_seconds_both_ends_of_them_included() -> None:
    limiter = Limiter(2)
    assert [limiter.admits(t) for t in (0.0, 4.0)] == [True, True]
    assert [limiter.admits(t) for t in (4.0, 5.5, 9.0, 10.0)] == [False] * 4
    assert [limiter.admits(t) for t in (10.01, 10.02, 14.0, 14.01)] == [True, False, False, True]


@pytest.mark.parametrize("key", [None, SigningKey(KEY)])
def test_rounds_once_a_second_leave_room_for_texts_and_always_have_their_own(
    key: SigningKey | None,
) -> None:
    way = Noted()
    publisher = Publisher({"there": way}, 194, key)
    for second in range(60):
        way.now_s = float(second)
        for number in range(2 * MOST_WAITING):
            publisher.say(1, INFO, f"{second} {number} " + 50 * "x")
        assert publisher.send_round(1, 0, VALUES, way.now_s)
        publisher.send_texts(way.now_s)
    texts = [m for m in way.messages() if m.get_type() == "STATUSTEXT"]
    assert len(texts) > 40
    assert int(texts[-1].text.split()[0]) >= 48  # of the newest, not what piled up


def test_a_round_is_what_a_ground_station_reads_of_a_component_of_the_vehicle() -> None:
    way = Noted()
    publisher = Publisher({"there": way}, 194)
    publisher.send_round(7, (1 << 32) + 123_456_789, VALUES | {"yaw_z_sd": math.nan}, 0.0)
    publisher.say(7, NOTICE, "yawid: usable, \u03c9n 10.06")
    publisher.send_texts(0.0)
    beat, *values, text = way.messages()
    assert (beat.type, beat.autopilot) == (18, 8)
    assert {(m.get_srcSystem(), m.get_srcComponent()) for m in (beat, *values, text)} == {(7, 194)}
    known = {name: value for name, value in VALUES.items() if name != "yaw_z_sd"}
    assert {m.name: m.value for m in values} == pytest.approx(known)
    assert {m.time_boot_ms for m in values} == {123_456_789}
    assert (text.severity, text.text) == (5, "yawid: usable, ?n 10.06")


def test_udpin_answers_who_sent_last_and_a_peer_that_is_gone_is_said_once_until_it_is_back() -> (
    None
):
    with (
        ExitStack() as opened,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as station,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as again,
    ):
        station.bind(("127.0.0.1", 0))
        address, way = station.getsockname(), OverUdp(Endpoint("127.0.0.1", 0), opened)
        here = Publisher({"here": way}, 194)
        here.send_round(1, 0, VALUES, 0.0)
        station.sendto(3000 * b"x", way.socket.getsockname())
        here.send_round(1, 0, VALUES, 1.0)
        assert len(received(station)) == 6

        station.close()
        there = Publisher({"there": OverUdp(Endpoint(*address, "udpout"), opened)}, 194)
        for second in range(3):
            there.send_round(1, 0, VALUES, float(second))
        [line] = there.news
        assert "nothing receives what is published to there" in line
        again.bind(address)
        there.send_round(1, 0, VALUES, 10.0)
        assert len(received(again)) == 6


def test_a_tcp_peer_that_does_not_read_holds_nothing_up_and_gets_whole_frames() -> None:
    frame = bytes(mavlink.MAVLink_system_time_message(1, 2).pack(mavlink.MAVLink(None)))
    with socket.create_server(("127.0.0.1", 0)) as server:
        tap = StreamTap(Endpoint(*server.getsockname(), "tcp"), may_transmit=True)
        tap._connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 4096)
        server.settimeout(60.0)
        peer, _ = server.accept()
        peer.settimeout(60.0)
        with tap, peer:
            tap.senders.first[1] = "127.0.0.1", 1
            went = 0
            while tap.transmit(frame, 1):
                went += 1
                assert went < 1_000_000
            assert not tap.transmit(frame, 1)
            data = peer.recv(1 << 20)
            while len(data) % len(frame) or not tap.transmit(frame, 1):
                tap.transmit(frame, 1)
                data += peer.recv(1 << 20)
            assert data == len(data) // len(frame) * frame


@pytest.mark.parametrize(
    ("text", "tapped", "said"),
    [
        ("127.0.0.1:14550", "udpin:127.0.0.1:14560", "must be udpout:HOST:PORT"),
        ("tcp:127.0.0.1:5760", "udpin:127.0.0.1:14560", "or tap"),
        ("mcast:", "udpin:127.0.0.1:14560", "or tap"),
        ("/dev/ttyUSB0", "udpin:127.0.0.1:14560", "or tap"),
        ("udpout:127.0.0.1:14560", "udpin:0.0.0.0:14560", "write --publish tap"),
        ("udpin:127.0.0.1:14560", "udpin:127.0.0.1:14560", "write --publish tap"),
        ("udpin:0.0.0.0:14560", "udpin:127.0.0.1:14560", "write --publish tap"),
        ("udpin:10.0.0.7:14560", "udpin:0.0.0.0:14560", "write --publish tap"),
        ("udpin:[::]:14560", "udpin:[::1]:14560", "write --publish tap"),
        ("udpin:0.0.0.0:14550", "mcast:", "write --publish tap"),
        ("tap", "mcast:", "a group cannot be answered"),
    ],
)
def test_what_cannot_be_published_to_is_refused_in_one_line(
    text: str, tapped: str, said: str
) -> None:
    with pytest.raises(ConfigError) as caught:
        parse_publish(text, parse_endpoint(tapped))
    assert said in str(caught.value)
    assert f"--publish {text}" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_the_tap_s_own_endpoint_means_the_tap() -> None:
    tapped = parse_endpoint("tcp:127.0.0.1:5760")
    assert parse_publish("tap", tapped) is parse_publish("tcp:127.0.0.1:5760", tapped) is None
    apart = parse_endpoint("udpin:127.0.0.1:14561")
    assert parse_publish(str(apart), parse_endpoint("udpin:127.0.0.1:14560")) == apart
    assert parse_publish("udpout:10.0.0.1:5760", tapped) == Endpoint("10.0.0.1", 5760, "udpout")
