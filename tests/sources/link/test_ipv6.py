"""IPv6 is an address like another: taps on real sockets of the loopback."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from live_link import frames, heard, listening, tlog_size, wait_for_size
from sources.tlog_records import BY_NAME, message, pack, random_records, sender

from yawid.errors import SourceError
from yawid.sources.link.endpoints import Endpoint
from yawid.sources.link.receiver import _address
from yawid.sources.link.tcp_serial import StreamTap
from yawid.sources.link.udp import UdpTap

FRAMES = [rec[8:] for rec in random_records(np.random.default_rng(0), 50)]


def has_ipv6() -> bool:
    try:
        with socket.socket(socket.AF_INET6, socket.SOCK_DGRAM) as probe:
            probe.bind(("::1", 0))
    except OSError:
        return False
    return True


pytestmark = pytest.mark.skipif(not has_ipv6(), reason="no IPv6 here")


@pytest.fixture
def vehicle() -> Iterator[socket.socket]:
    with socket.socket(socket.AF_INET6, socket.SOCK_DGRAM) as link:
        link.bind(("::1", 0))
        link.settimeout(60.0)
        yield link


def test_datagrams_come_whole_and_an_answer_goes_back_to_their_sender(
    vehicle: socket.socket,
) -> None:
    with UdpTap(Endpoint("::1", 0), may_transmit=True) as tap:
        for frame in FRAMES:
            vehicle.sendto(frame, tap.address)
        data = heard(tap, tlog_size(FRAMES))
        known = dict(tap.senders.first)
        assert tap.transmit(b"hello", next(iter(known)))
        assert vehicle.recv(100) == b"hello"
    assert len(data) == tlog_size(FRAMES)
    assert set(known.values()) == {("::1", vehicle.getsockname()[1])}


def test_a_udpout_speaks_to_who_listens_there(vehicle: socket.socket) -> None:
    port = vehicle.getsockname()[1]
    with UdpTap(Endpoint("::1", port, "udpout"), may_transmit=True) as tap:
        assert tap.transmit(b"hello", 1)
        question, address = vehicle.recvfrom(100)
        vehicle.sendto(FRAMES[0], address)
        assert heard(tap, 1)[8:] == FRAMES[0]
    assert question == b"hello"


def test_two_addresses_of_one_system_are_named_in_brackets(vehicle: socket.socket) -> None:
    beat = pack(message(BY_NAME["HEARTBEAT"], b"\1\2\3\4\5\6\7\x08\x03"), sender())
    with (
        socket.socket(socket.AF_INET6, socket.SOCK_DGRAM) as forger,
        UdpTap(Endpoint("::1", 0)) as tap,
    ):
        for link in (vehicle, forger):
            link.sendto(beat, tap.address)
        heard(tap, 2 * (8 + len(beat)))
        [said] = tap.news
    assert f"[::1]:{vehicle.getsockname()[1]}" in said


def test_all_addresses_of_ipv6_leave_the_port_free_for_ipv4() -> None:
    with (
        UdpTap(Endpoint("::", 0)) as tap,
        UdpTap(Endpoint("0.0.0.0", tap.address[1])) as other,
    ):
        assert tap.address[1] == other.address[1]


def test_an_address_of_another_machine_is_one_line_with_the_remedy() -> None:
    with pytest.raises(SourceError, match=r"not an address of this machine: use ::1 or ::$"):
        UdpTap(Endpoint("2001:db8::7", 14560))


def test_a_sender_on_a_link_of_its_own_is_named_with_the_link() -> None:
    assert _address("fe80::1", 14550, 0, 2) == ("fe80::1%2", 14550)


def test_a_tcp_connection_is_recorded_and_can_be_answered() -> None:
    with socket.create_server(("::1", 0), family=socket.AF_INET6) as server:
        host, port, *_ = server.getsockname()
        tap = StreamTap(Endpoint(host, port, "tcp"), may_transmit=True)
        server.settimeout(60.0)
        vehicle, _ = server.accept()
        with tap, vehicle:
            vehicle.sendall(b"".join(FRAMES))
            assert len(heard(tap, tlog_size(FRAMES))) == tlog_size(FRAMES)
            assert tap.transmit(b"hello", next(iter(tap.senders.first)))
            vehicle.settimeout(60.0)
            assert vehicle.recv(100) == b"hello"
            assert str(tap.endpoint) == f"tcp:[::1]:{port}"


def test_a_whole_session_over_ipv6(tmp_path: Path, vehicle: socket.socket) -> None:
    with UdpTap(Endpoint("::1", 0)) as probe:
        port = probe.address[1]
    sent = frames(20.0)
    with listening(tmp_path, endpoint=f"udpin:[::1]:{port}") as session:
        for frame in sent:
            vehicle.sendto(frame, ("::1", port))
        wait_for_size(session.part("tlog"), tlog_size(sent))
    assert f"listening on udpin:[::1]:{port}" in session.screen.getvalue()
    assert session.ended[0].summary.estimates["els"].updates > 100
    assert (tmp_path / "live.tlog").stat().st_size == tlog_size(sent)
