"""The tap on real sockets: what was sent comes out as a tlog, and nothing goes back."""

from __future__ import annotations

import contextlib
import socket
import sys
import threading
import time
from collections.abc import Iterator

import numpy as np
import pytest
from checks.children import free_udp_port
from sources.tlog_records import BY_NAME, message, pack, random_records, rows, run, sender

from yawid.channels.stage import WANTED
from yawid.errors import SourceError
from yawid.sources.link.endpoints import Endpoint
from yawid.sources.link.inbox import MOST_AT_ONCE, Inbox, Stamps
from yawid.sources.link.tap import split_datagram
from yawid.sources.link.udp import UdpTap, dropped_by
from yawid.sources.mavlink.decoder import Decoder

ANY_PORT = Endpoint("127.0.0.1", 0)
FRAMES = [rec[8:] for rec in random_records(np.random.default_rng(0), 300)]


@pytest.fixture
def tap() -> Iterator[UdpTap]:
    with UdpTap(ANY_PORT) as opened:
        yield opened


@pytest.fixture
def vehicle() -> Iterator[socket.socket]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link:
        yield link


def heard(tap: UdpTap, datagrams: int) -> bytes:
    """Read until that many datagrams have been heard and handed out."""
    data, patience = b"", time.monotonic() + 60.0
    while tap.inbox.received < datagrams and time.monotonic() < patience:
        data += tap.read(1)
    return data + tap.read(0)


def test_every_frame_sent_comes_out_as_a_record(tap: UdpTap, vehicle: socket.socket) -> None:
    for i in range(0, len(FRAMES), 3):
        vehicle.sendto(b"".join(FRAMES[i : i + 3]), tap.address)
    records = heard(tap, 100)
    blocks, decoder = run(records)
    assert decoder.link.frames == len(FRAMES)
    assert decoder.link.skipped_bytes == tap.skipped_bytes == tap.inbox.dropped == 0
    stamps = [row[2] for row in rows(blocks)]
    assert stamps == sorted(stamps)
    assert all(len(set(stamps[i : i + 3])) == 1 for i in range(0, len(FRAMES), 3))


def test_replaying_what_was_recorded_gives_the_same_messages(
    tap: UdpTap, vehicle: socket.socket
) -> None:
    decoder = Decoder(WANTED)
    recorded, live = b"", []
    for i, frame in enumerate(FRAMES[:60]):
        vehicle.sendto(frame, tap.address)
        data = heard(tap, i + 1)
        recorded += data
        live.append(decoder.feed(data))
    live.append(decoder.finish())
    replayed = Decoder(WANTED)
    again = [replayed.feed(recorded), replayed.finish()]
    assert rows([block for block in live if block]) == rows([block for block in again if block])
    assert decoder.link == replayed.link


def test_bytes_that_are_no_frame_stay_out_and_are_counted(
    tap: UdpTap, vehicle: socket.socket
) -> None:
    vehicle.sendto(b"hello", tap.address)
    vehicle.sendto(b"ab" + FRAMES[0] + b"cde" + FRAMES[1] + FRAMES[2][:-1], tap.address)
    vehicle.sendto(b"", tap.address)
    records = heard(tap, 3)
    assert tap.skipped_bytes == 5 + 2 + 3 + len(FRAMES[2]) - 1
    assert len(records) == 16 + len(FRAMES[0]) + len(FRAMES[1])


def test_nothing_is_ever_transmitted(tap: UdpTap, vehicle: socket.socket) -> None:
    for frame in FRAMES[:50]:
        vehicle.sendto(frame, tap.address)
    heard(tap, 50)
    tap.close()
    vehicle.settimeout(0)
    with pytest.raises(BlockingIOError):
        vehicle.recv(1)


def test_a_silent_link_reads_as_no_bytes(tap: UdpTap) -> None:
    assert tap.read(0.01) == b""


def test_what_a_full_queue_cannot_take_is_counted(vehicle: socket.socket) -> None:
    with UdpTap(ANY_PORT, queue_size=10) as tap:
        for _ in range(25):
            vehicle.sendto(FRAMES[0], tap.address)
        patience = time.monotonic() + 60.0
        while tap.inbox.received < 25 and time.monotonic() < patience:
            time.sleep(0)
        assert tap.inbox.dropped == 15
        assert len(tap.read(1)) == 10 * (8 + len(FRAMES[0]))


def put(inbox: Inbox, *sizes: int) -> None:
    """Receive datagrams of these sizes, all of one read."""
    inbox.put([(1, bytes(size), ("127.0.0.1", 1)) for size in sizes])


def test_the_queue_is_bounded_in_bytes_and_what_is_too_long_is_counted() -> None:
    inbox = Inbox(1000, most_bytes=20_000)
    put(inbox, 9000, 9001, 65_000, 9000)
    assert (len(inbox), inbox.too_long, inbox.dropped, inbox.received) == (2, 2, 0, 4)
    put(inbox, 1500, 600, 100)  # of these the first has room
    assert (len(inbox), inbox.too_long, inbox.dropped, inbox.received) == (3, 2, 2, 7)
    assert [len(datagram) for _, datagram, _ in inbox.get()] == [9000, 9000, 1500]
    put(inbox, 65_000)
    put(inbox, 9000, 9000)  # there is room again
    assert (len(inbox), inbox.too_long, inbox.dropped) == (2, 3, 2)
    assert inbox.skip() == 18_000
    assert (len(inbox), inbox.skipped, list(inbox.get())) == (0, 2, [])


def test_a_read_takes_no_more_than_a_megabyte_of_a_backlog() -> None:
    inbox = Inbox(1000)
    for _ in range(200):
        put(inbox, 9000)
    sizes = []
    while len(inbox):
        sizes.append(sum(len(datagram) for _, datagram, _ in inbox.get()))
    assert sum(sizes) == 200 * 9000
    assert max(sizes) <= (1 << 20) + 9000


def test_a_flood_of_long_datagrams_does_not_fill_the_memory(
    tap: UdpTap, vehicle: socket.socket
) -> None:
    for _ in range(50):
        vehicle.sendto(bytes(65_000), tap.address)
        vehicle.sendto(FRAMES[0], tap.address)
        time.sleep(0.001)
    assert len(heard(tap, 100)) == 50 * (8 + len(FRAMES[0]))
    assert (tap.inbox.too_long, tap.inbox.dropped) == (50, 0)


@pytest.mark.parametrize("junk", [b"\xfd", b"\xfe\xff\xff", b"\xfd\xff\x00"])
def test_bytes_made_to_look_like_frames_cost_little(junk: bytes) -> None:
    begun_s = time.process_time()
    for _ in range(100):
        for frame in split_datagram((junk * 9000)[:9000]):
            assert frame[:3] == (junk * 3)[:3]
    assert time.process_time() - begun_s < 5.0  # a hundred times what it takes


def test_what_comes_while_nobody_reads_waits(tap: UdpTap, vehicle: socket.socket) -> None:
    for frame in FRAMES:
        vehicle.sendto(frame, tap.address)
    patience = time.monotonic() + 60.0
    while tap.inbox.received < len(FRAMES) and time.monotonic() < patience:
        time.sleep(0)
    assert len(tap.read(0.0)) == sum(8 + len(frame) for frame in FRAMES)
    assert tap.inbox.dropped == tap.socket_dropped == 0


def test_a_backlog_is_taken_without_a_pause(tap: UdpTap, monkeypatch: pytest.MonkeyPatch) -> None:
    count, parts = MOST_AT_ONCE // 8, 20
    for _ in range(parts):
        tap.inbox.put([(1, FRAMES[0], ("127.0.0.1", 1))] * count)
    pauses: list[float] = []
    monkeypatch.setattr("yawid.sources.link.tap.time.sleep", pauses.append)
    data = b""
    while len(tap.inbox) >= MOST_AT_ONCE:
        data += tap.read(1.0)
    assert (pauses, len(data) > 0) == ([], True)
    data += tap.read(1.0)
    assert len(data) == parts * count * (8 + len(FRAMES[0]))


def test_closing_ends_the_thread_and_frees_the_port(vehicle: socket.socket) -> None:
    before = threading.active_count()
    with UdpTap(ANY_PORT) as tap:
        port = tap.address[1]
        vehicle.sendto(FRAMES[0], tap.address)
        assert heard(tap, 1)
    assert threading.active_count() == before
    with UdpTap(Endpoint("127.0.0.1", port)):
        pass


def test_a_port_in_use_is_refused_with_a_remedy(tap: UdpTap) -> None:
    port = tap.address[1]
    with pytest.raises(SourceError, match=f"port {port} is in use: end the program"):
        UdpTap(Endpoint("127.0.0.1", port))


@pytest.mark.parametrize("host", ["203.0.113.7", "no host"])
def test_an_address_of_another_machine_is_refused_with_a_remedy(host: str) -> None:
    with pytest.raises(SourceError, match=r"use 127\.0\.0\.1 or 0\.0\.0\.0"):
        UdpTap(Endpoint(host, 14560))


def test_the_buffer_is_asked_for_and_its_size_reported(tap: UdpTap) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as plain:
        usual = plain.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF)
    assert tap.receive_buffer >= usual


def test_a_frame_cut_off_by_the_end_of_a_datagram_is_no_frame() -> None:
    frame = pack(message(BY_NAME["VIBRATION"], b"\x01" * 32), sender())
    for size in range(len(frame)):
        assert frame not in list(split_datagram(frame[:size]))
    assert list(split_datagram(frame)) == [frame]


def test_a_passive_tap_refuses_to_transmit(tap: UdpTap, vehicle: socket.socket) -> None:
    vehicle.sendto(FRAMES[0], tap.address)
    heard(tap, 1)
    with pytest.raises(RuntimeError, match="passive"):
        tap.transmit(FRAMES[0], FRAMES[0][5])


def test_what_the_system_has_no_room_for_is_counted(vehicle: socket.socket) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as full:
        full.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        full.bind(("127.0.0.1", 0))
        for _ in range(500):
            vehicle.sendto(FRAMES[0], full.getsockname())
        full.setblocking(False)
        dropped = dropped_by(full)
        taken = 0
        with contextlib.suppress(BlockingIOError):
            while full.recv(2048):
                taken += 1
    if dropped is None:
        pytest.skip("this system does not count")
    assert (taken + dropped, dropped > 0) == (500, True)


def test_a_group_is_heard_by_everyone_who_joins_it() -> None:
    endpoint = Endpoint("239.255.145.50", free_udp_port(), "mcast")
    with (
        UdpTap(endpoint) as one,
        UdpTap(endpoint) as two,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle,
    ):
        try:
            vehicle.sendto(FRAMES[0], (endpoint.host, endpoint.port))
        except OSError as error:
            pytest.skip(f"this machine has no multicast: {error}")
        assert [heard(tap, 1)[8:] for tap in (one, two)] == [FRAMES[0]] * 2


def test_a_broadcast_is_heard(vehicle: socket.socket) -> None:
    endpoint = Endpoint("127.255.255.255", free_udp_port(), "udpbcast")
    vehicle.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
    with UdpTap(endpoint) as tap:
        vehicle.sendto(FRAMES[0], (endpoint.host, endpoint.port))
        assert heard(tap, 1)[8:] == FRAMES[0]


def test_a_peer_that_waits_to_be_spoken_to_answers_the_tap(vehicle: socket.socket) -> None:
    vehicle.bind(("127.0.0.1", 0))
    vehicle.settimeout(60.0)
    endpoint = Endpoint(*vehicle.getsockname(), "udpout")
    with UdpTap(endpoint, may_transmit=True) as tap:
        assert tap.transmit(FRAMES[1], 0)
        data, address = vehicle.recvfrom(2048)
        vehicle.sendto(FRAMES[0], address)
        assert (data, heard(tap, 1)[8:]) == (FRAMES[1], FRAMES[0])


def test_stamps_go_on_evenly_when_the_clock_is_set_and_the_jump_is_said_once() -> None:
    wall, steady = [5_000_000_000_000], [0]
    stamps = Stamps(lambda: wall[0], lambda: steady[0])
    wall[0] += 2_000_000_000
    steady[0] += 2_000_000_000
    assert (stamps.now(), stamps.jump()) == (5_002_000_000, None)
    wall[0] -= 3_600_000_000_000
    assert (stamps.now(), stamps.jump(), stamps.jump()) == (5_002_000_000, -3600.0, None)
    steady[0] += 1_000_000_000
    wall[0] += 3_601_000_000_000
    assert (stamps.now(), stamps.jump()) == (5_003_000_000, 3600.0)


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux tells when a datagram arrived")
def test_a_stamp_is_when_the_datagram_arrived_though_it_gathers_with_others(
    tap: UdpTap, vehicle: socket.socket
) -> None:
    sent = []
    for frame in FRAMES[:8]:
        before_us = tap.stamps.now()
        vehicle.sendto(frame, tap.address)
        sent.append((before_us, tap.stamps.now()))
        time.sleep(0.005)
    stamps = [row[2] for row in rows(run(heard(tap, 8))[0])]
    clock_us = 200  # two clocks are read one after the other
    assert all(
        first - clock_us <= stamp <= last + clock_us
        for stamp, (first, last) in zip(stamps, sent, strict=True)
    )


@pytest.mark.parametrize("jump_s", [-3600, 3600])
def test_a_clock_set_while_datagrams_gather_moves_no_stamp(
    jump_s: int, vehicle: socket.socket
) -> None:
    ahead_ns = [0]
    stamps = Stamps(lambda: time.time_ns() + ahead_ns[0])
    with UdpTap(ANY_PORT, stamps=stamps) as tap:
        begun_us = stamps.now()
        vehicle.sendto(FRAMES[0], tap.address)
        data = heard(tap, 1)
        # The system's stamps are as ever; for us its clock has jumped.
        ahead_ns[0] = jump_s * 1_000_000_000
        for frame in FRAMES[1:4]:
            vehicle.sendto(frame, tap.address)
        data += heard(tap, 4)
        ended_us = stamps.now()
    got = [row[2] for row in rows(run(data)[0])]
    assert got == sorted(got)
    assert begun_us - 200 <= got[0] <= got[-1] <= ended_us
