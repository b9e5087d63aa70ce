"""Every way to a vehicle: as it is written, and on real sockets and lines."""

from __future__ import annotations

import os
import re
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from checks.children import free_udp_port
from live_link import heard, tlog_size
from sources.tlog_records import BY_NAME, message, pack, random_records, rows, run, sender

from yawid.errors import ConfigError, SourceError
from yawid.sources.link.endpoints import Endpoint, parse_endpoint
from yawid.sources.link.receiver import _address
from yawid.sources.link.tap import Tap
from yawid.sources.link.tcp_serial import StreamTap
from yawid.sources.link.udp import UdpTap

FRAMES = [rec[8:] for rec in random_records(np.random.default_rng(0), 200)]
HOSTS = {"4": "127.0.0.1", "6": "::1"}
GROUPS = {"mcast": "239.255.145.50", "udpbcast": "127.255.255.255"}
FAMILIES = {"4": socket.AF_INET, "6": socket.AF_INET6}


def has_ipv6() -> bool:
    try:
        with socket.socket(socket.AF_INET6, socket.SOCK_DGRAM) as probe:
            probe.bind(("::1", 0))
    except OSError:
        return False
    return True


class Way(NamedTuple):
    """A tap, its vehicle, and what sends bytes from there to the tap."""

    tap: Tap
    vehicle: socket.socket
    send: Callable[[bytes], Any]


def udp(name: str, stack: ExitStack, may_transmit: bool) -> Way:
    kind, number = name.rstrip("46"), name[-1] if name[-1] in "46" else "4"
    vehicle = stack.enter_context(socket.socket(FAMILIES[number], socket.SOCK_DGRAM))
    vehicle.settimeout(60.0)
    vehicle.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
    place = GROUPS.get(kind, HOSTS[number]), 0 if kind == "udpin" else free_udp_port()
    if kind == "udpout":
        vehicle.bind(place)
    tap = stack.enter_context(UdpTap(Endpoint(*place, kind), may_transmit=may_transmit))
    to = place if kind in GROUPS else tap.address
    return Way(tap, vehicle, lambda data: vehicle.sendto(data, to))


def tcp(name: str, stack: ExitStack, may_transmit: bool) -> Way:
    host, family = HOSTS[name[-1]], FAMILIES[name[-1]]
    server = stack.enter_context(socket.create_server((host, 0), family=family))
    server.settimeout(60.0)
    endpoint = Endpoint(host, server.getsockname()[1], "tcp")
    tap = stack.enter_context(StreamTap(endpoint, may_transmit=may_transmit))
    vehicle, _ = server.accept()
    stack.enter_context(vehicle).settimeout(60.0)
    return Way(tap, vehicle, vehicle.sendall)


@contextmanager
def serial_line(device: Path) -> Iterator[int]:
    """A serial line whose one end is the device, the other the descriptor that is yielded."""
    vehicle, line = os.openpty()
    device.unlink(missing_ok=True)
    device.symlink_to(os.ttyname(line))
    try:
        yield vehicle
    finally:
        os.close(line)
        os.close(vehicle)


@pytest.fixture
def opened() -> Iterator[Callable[..., Way]]:
    with ExitStack() as stack:

        def open_way(name: str, *, may_transmit: bool = False) -> Way:
            if name.endswith("6") and not has_ipv6():
                pytest.skip("no IPv6 here")
            return (tcp if name.startswith("tcp") else udp)(name, stack, may_transmit)

        yield open_way


WAYS = ("udpin4", "udpin6", "udpout4", "mcast", "udpbcast", "tcp4", "tcp6")


@pytest.mark.parametrize("name", WAYS)
def test_every_frame_comes_out_as_a_record_and_nothing_is_sent_back(
    name: str, opened: Callable[..., Way]
) -> None:
    way = opened(name)
    step = 3 if "udp" in name or name == "mcast" else 200
    for i in range(0, len(FRAMES), step):
        try:
            way.send(b"".join(FRAMES[i : i + step]))
        except OSError as error:
            pytest.skip(f"this machine has no {name}: {error}")
    data = heard(way.tap, tlog_size(FRAMES))
    blocks, decoder = run(data)
    assert decoder.link.frames == len(FRAMES)
    assert decoder.link.skipped_bytes == way.tap.skipped_bytes == way.tap.inbox.dropped == 0
    stamps = [row[2] for row in rows(blocks)]
    assert stamps == sorted(stamps)
    if step == 3:
        assert all(len(set(stamps[i : i + 3])) == 1 for i in range(0, len(stamps), 3))
        assert way.tap.socket_dropped == 0
    with pytest.raises(RuntimeError, match="passive"):
        way.tap.transmit(FRAMES[0], FRAMES[0][5])
    way.vehicle.settimeout(0.0)
    with pytest.raises(BlockingIOError):
        way.vehicle.recv(2048)


@pytest.mark.parametrize("name", ["udpin4", "udpin6", "udpout4", "udpout6", "tcp4", "tcp6"])
def test_an_answer_goes_back_to_who_was_heard(name: str, opened: Callable[..., Way]) -> None:
    way = opened(name, may_transmit=True)
    if name.startswith("udpout"):  # it waits to be spoken to
        assert way.tap.transmit(b"hello", 1)
        assert way.vehicle.recv(2048) == b"hello"
    way.send(FRAMES[0])
    assert heard(way.tap, 1)[8:] == FRAMES[0]
    assert way.tap.transmit(b"hello", next(iter(way.tap.senders.first)))
    assert way.vehicle.recv(2048) == b"hello"


def lost_and_back(tap: Tap) -> bool:
    return [("lost" in line, "back" in line) for line in tap.news] == [(True, False), (False, True)]


def test_a_connection_that_is_lost_is_sought_again_and_both_are_said() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(60.0)
        with StreamTap(Endpoint(*server.getsockname(), "tcp")) as tap:
            for frame in FRAMES[:2]:
                with server.accept()[0] as vehicle:
                    vehicle.sendall(frame)
                    assert heard(tap, 1)[8:] == frame
            assert lost_and_back(tap)


def test_a_serial_device_that_is_pulled_out_is_sought_again_and_both_are_said(
    tmp_path: Path,
) -> None:
    device = tmp_path / "tty"
    with ExitStack() as stack:
        with serial_line(device) as vehicle:
            tap = stack.enter_context(StreamTap(Endpoint(str(device), 57600, "serial")))
            os.write(vehicle, FRAMES[0])
            assert heard(tap, 1)[8:] == FRAMES[0]
        vehicle = stack.enter_context(serial_line(device))
        patience = time.monotonic() + 60.0
        while not any("back" in news for news in tap.news) and time.monotonic() < patience:
            time.sleep(0.05)
        os.write(vehicle, FRAMES[1])
        assert heard(tap, 1)[8:] == FRAMES[1]
        assert lost_and_back(tap)


def test_what_cannot_be_opened_is_one_line_with_the_remedy(
    opened: Callable[..., Way], monkeypatch: pytest.MonkeyPatch
) -> None:
    in_use = opened("udpin4").tap.address[1]
    with socket.create_server(("127.0.0.1", 0)) as server:
        gone = server.getsockname()[1]
    for kind, host, port, text in (
        ("udpin", "127.0.0.1", in_use, f"port {in_use} is in use: end the program"),
        ("udpin", "203.0.113.7", 14560, r"use 127\.0\.0\.1 or 0\.0\.0\.0"),
        ("udpin", "no host", 14560, r"use 127\.0\.0\.1 or 0\.0\.0\.0"),
        ("udpin", "2001:db8::7", 14560, r"not an address of this machine: use ::1 or ::$|no IPv6"),
        ("tcp", "127.0.0.1", gone, "nothing listens there"),
        ("serial", "/dev/ttyNone", 57600, "no such device"),
        ("extra", "/dev/ttyUSB0", 57600, r"/dev/ttyUSB0,57600: .*pip install 'yawid\[serial\]'"),
    ):
        if kind == "extra":
            monkeypatch.setitem(sys.modules, "serial", None)
        made = UdpTap if kind == "udpin" else StreamTap
        with pytest.raises(SourceError, match=text) as caught:
            made(Endpoint(host, port, kind.replace("extra", "serial")))
        assert "\n" not in str(caught.value)


def test_bytes_that_are_no_frame_stay_out_and_are_counted(opened: Callable[..., Way]) -> None:
    way = opened("udpin4")
    torn = FRAMES[2][:-1]
    long = b"".join(FRAMES[3:40])
    for datagram in (b"", b"hello", b"ab" + FRAMES[0] + b"cde" + FRAMES[1] + torn, long, b""):
        way.send(datagram)
    size = tlog_size([*FRAMES[:2], *FRAMES[3:40]])
    assert len(heard(way.tap, size)) == size
    assert way.tap.skipped_bytes == 5 + 2 + 3 + len(torn)
    assert way.tap.read(0.01) == b""


def test_a_listener_that_is_not_there_yet_is_waited_for() -> None:
    place = "127.0.0.1", free_udp_port()
    with UdpTap(Endpoint(*place, "udpout"), may_transmit=True) as tap:
        for _ in range(3):
            tap.transmit(FRAMES[0], 1)
            assert tap.read(0.2) == b""
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle:
            vehicle.bind(place)
            vehicle.sendto(FRAMES[0], tap.address)
            assert heard(tap, 1)[8:] == FRAMES[0]


def test_closing_ends_the_thread_and_frees_the_port() -> None:
    before, port = threading.active_count(), 0
    for _ in range(2):
        with UdpTap(Endpoint("127.0.0.1", port)) as tap:
            port = tap.address[1]
        assert threading.active_count() == before


@pytest.mark.skipif(not has_ipv6(), reason="no IPv6 here")
def test_all_addresses_of_ipv6_leave_the_port_free_for_ipv4_and_are_named_in_brackets() -> None:
    beat = pack(message(BY_NAME["HEARTBEAT"], b"\1\2\3\4\5\6\7\x08\x03"), sender())
    with (
        UdpTap(Endpoint("::", 0)) as tap,
        UdpTap(Endpoint("0.0.0.0", tap.address[1])) as other,
        socket.socket(socket.AF_INET6, socket.SOCK_DGRAM) as one,
        socket.socket(socket.AF_INET6, socket.SOCK_DGRAM) as two,
    ):
        assert tap.address[1] == other.address[1]
        for link in (one, two):
            link.sendto(beat, ("::1", tap.address[1]))
        heard(tap, tlog_size([beat, beat]))
        [said] = tap.news
        assert f"[::1]:{one.getsockname()[1]}" in said
    assert _address("fe80::1", 14550, 0, 2) == ("fe80::1%2", 14550)


WHOLE = (
    "udpin:127.0.0.1:14560", "udpin:0.0.0.0:14560", "udpout:10.0.0.1:14550",
    "udpbcast:192.168.1.255:14550", "tcp:127.0.0.1:5760", "mcast:239.1.2.3:14551",
    "/dev/ttyUSB0,921600", "COM3,57600", "com3,57600", "udpin:[::1]:14560", "udpin:[::]:14560",
    "udpout:[2001:db8::7]:14550", "tcp:[fe80::1%eth0]:5760", "udpin:[::ffff:10.0.0.1]:14560",
)  # fmt: skip


@pytest.mark.parametrize(
    ("text", "meant"),
    [
        *[(text, text) for text in WHOLE],
        ("mcast:", "mcast:239.255.145.50:14550"),
        ("mcast:14551", "mcast:239.255.145.50:14551"),
        ("/dev/ttyACM0", "/dev/ttyACM0,57600"),
    ],
)
def test_an_endpoint_is_taken_and_what_it_leaves_out_is_pymavlink_s_default(
    text: str, meant: str
) -> None:
    assert str(parse_endpoint(text)) == meant


@pytest.mark.parametrize(
    "text",
    ["udp:", "udp:127.0.0.1:14550", "udpin:14550", "udpin:", "udpin::14550", "14550", "",
     "127.0.0.1:14550", "udpin:127.0.0.1:", "udpin:127.0.0.1:port", "udpin:127.0.0.1:70000"],
)  # fmt: skip
def test_an_endpoint_that_leaves_something_open_is_refused_with_both_spellings(text: str) -> None:
    port = "14550" if "14550" in text else "14560"
    with pytest.raises(ConfigError) as caught:
        parse_endpoint(text)
    assert f"udpin:127.0.0.1:{port}" in str(caught.value)
    assert f"udpin:0.0.0.0:{port}" in str(caught.value)
    assert "\n" not in str(caught.value)


NO_BAUD = "not a baud rate: write /dev/ttyUSB0,57600"
NO_KIND = "not supported, write udpin:127.0.0.1"
BRACKETS = "in brackets, after udpin, udpout or tcp: write udpin:[::1]:14560"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        *[(text, NO_BAUD) for text in ("/dev/ttyUSB0,0", "/dev/ttyUSB0,99999999999")],
        *[(text, NO_KIND) for text in ("tcpin:0.0.0.0:5760", "ws:127.0.0.1:1", "unix:/tmp/x")],
        *[
            (text, BRACKETS)
            for text in (
                "udpin:::1:14560", "udpin:[::1]", "udpin:[::1:14560", "udpbcast:[::1]:14560",
                "mcast:[ff02::1]:14550", "tcp:2001:db8::7:5760", "udpin:[::1]:14560:",
            )
        ],
        # Brackets are for IPv6 alone.
        *[(text, "does not say where") for text in ("udpin:[127.0.0.1]:14560", "udpin:[12]:14560")],
    ],
)  # fmt: skip
def test_what_is_no_endpoint_is_refused_in_one_line_with_the_right_spelling(
    text: str, said: str
) -> None:
    with pytest.raises(ConfigError, match=re.escape(said)) as caught:
        parse_endpoint(text)
    assert "\n" not in str(caught.value)
