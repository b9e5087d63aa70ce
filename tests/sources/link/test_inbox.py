"""What waits to be read: bounds, stamps, times of arrival, and who sends from where."""

from __future__ import annotations

import contextlib
import pickle
import socket
import sys
import time
from collections.abc import Iterator

import numpy as np
import pytest
from live_link import heard, tlog_size
from sources.tlog_records import random_records, rows, run

from yawid.sources.link.endpoints import Endpoint
from yawid.sources.link.inbox import MOST_AT_ONCE, Addresses, Inbox, Stamps
from yawid.sources.link.tap import split_datagram
from yawid.sources.link.udp import UdpTap, dropped_by

ANY_PORT = Endpoint("127.0.0.1", 0)
FRAMES = [rec[8:] for rec in random_records(np.random.default_rng(0), 8)]
CLOCK_US = 200  # two clocks are read one after the other


@pytest.fixture
def vehicle() -> Iterator[socket.socket]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link:
        yield link


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
    few = Inbox(3)
    put(few, 9001, 10, 9001, 10, 10, 9001, 10)  # long ones take no room from the others
    put(few, 10, 10)  # there is no room left
    assert (len(few), few.too_long, few.dropped) == (3, 3, 3)


def test_a_read_takes_no_more_than_a_megabyte_of_a_backlog() -> None:
    inbox, sizes = Inbox(1000), []
    for _ in range(200):
        put(inbox, 9000)
    while len(inbox):
        sizes.append(sum(len(datagram) for _, datagram, _ in inbox.get()))
    assert sum(sizes) == 200 * 9000
    assert max(sizes) <= (1 << 20) + 9000


def test_what_the_system_has_no_room_for_is_counted(vehicle: socket.socket) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as full:
        full.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        full.bind(("127.0.0.1", 0))
        for _ in range(500):
            vehicle.sendto(FRAMES[0], full.getsockname())
        full.setblocking(False)
        dropped, taken = dropped_by(full), 0
        with contextlib.suppress(BlockingIOError):
            while full.recv(2048):
                taken += 1
    if dropped is None:
        pytest.skip("this system does not count")
    assert (taken + dropped, dropped > 0) == (500, True)


def test_a_backlog_is_taken_without_a_pause(monkeypatch: pytest.MonkeyPatch) -> None:
    count, parts, pauses = MOST_AT_ONCE // 8, 20, []
    monkeypatch.setattr("yawid.sources.link.tap.time.sleep", pauses.append)
    with UdpTap(ANY_PORT) as tap:
        for _ in range(parts):
            tap.inbox.put([(1, FRAMES[0], ("127.0.0.1", 1))] * count)
        pauses.clear()
        data = b""
        while len(tap.inbox) >= MOST_AT_ONCE:
            data += tap.read(1.0)
        assert (pauses, len(data) > 0) == ([], True)
        data += tap.read(1.0)
    assert len(data) == parts * count * (8 + len(FRAMES[0]))


@pytest.mark.parametrize("junk", [b"\xfd", b"\xfe\xff\xff", b"\xfd\xff\x00"])
def test_bytes_made_to_look_like_frames_cost_little(junk: bytes) -> None:
    begun_s = time.process_time()
    for _ in range(20):
        for frame in split_datagram((junk * 9000)[:9000]):
            assert frame[:3] == (junk * 3)[:3]
    assert time.process_time() - begun_s < 1.0  # a hundred times what it takes


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


@pytest.mark.parametrize("jump_s", [-3600, 0, 3600])
def test_a_clock_set_while_datagrams_gather_moves_no_stamp(
    jump_s: int, vehicle: socket.socket
) -> None:
    ahead_ns, sent = [0], []
    stamps = Stamps(lambda: time.time_ns() + ahead_ns[0])
    with UdpTap(ANY_PORT, stamps=stamps) as tap:
        for i, frame in enumerate(FRAMES):
            if i == 1:  # the system's stamps are as ever; for us its clock has jumped
                data = heard(tap, 1)
                ahead_ns[0] = jump_s * 1_000_000_000
            before_us = stamps.now()
            vehicle.sendto(frame, tap.address)
            sent.append((before_us, stamps.now()))
            time.sleep(0.005)
        data += heard(tap, tlog_size(FRAMES[1:]))
    got = [row[2] for row in rows(run(data)[0])]
    assert got == sorted(got)
    assert sent[0][0] - CLOCK_US <= got[0] <= got[-1] <= stamps.now()
    if jump_s == 0 and sys.platform == "linux":  # each stamp is when its datagram arrived
        for stamp, (first, last) in zip(got, sent, strict=True):
            assert first - CLOCK_US <= stamp <= last + CLOCK_US


def test_a_flood_from_ever_new_ports_is_said_once_and_not_remembered() -> None:
    addresses = Addresses()
    lines = [
        addresses.observe({(1, ("127.0.0.1", port)): True}, 10 * port) for port in range(60_000)
    ]
    assert sum(map(len, lines)) == 1
    assert addresses.first == {1: ("127.0.0.1", 0)}
    assert len(pickle.dumps(addresses)) < 1000


VEHICLE, FORGER, MOVED = (("127.0.0.1", port) for port in (1, 2, 3))
S = 1_000_000


def observed(
    *heard: tuple[int, dict[tuple[str, int], bool]],
) -> tuple[tuple[str, int] | None, list[str]]:
    """Return the first address of system 1, and the news, after (time in us, trust by address)."""
    addresses, news = Addresses(), list[str]()
    for at_us, trust in heard:
        pairs = {(1, address): is_trusted for address, is_trusted in trust.items()}
        news += addresses.observe(pairs, at_us)
    return addresses.first.get(1), news


BOTH = {VEHICLE: True, FORGER: True}
FIVE_SECONDS = [(second * S, BOTH) for second in range(6)]


@pytest.mark.parametrize(
    ("later", "expected"),
    [((), VEHICLE), ((15 * S - 1,), VEHICLE), ((15 * S,), FORGER)],
)
def test_the_address_first_heard_from_stays_until_it_has_been_silent_for_ten_seconds(
    later: tuple[int, ...], expected: tuple[str, int]
) -> None:
    forged = [(at_us, {FORGER: True}) for at_us in (*range(6 * S, 15 * S - 1, S), *later)]
    assert observed(*FIVE_SECONDS, *forged)[0] == expected


FORGED = (0, {FORGER: False})
KNOWN = (1, {FORGER: False, VEHICLE: True})


@pytest.mark.parametrize(
    ("heard", "expected"),
    [
        ([FORGED], None),
        ([FORGED, KNOWN], VEHICLE),
        # At 9 s somebody forged the vehicle's address.
        ([FORGED, KNOWN, (9 * S, {VEHICLE: False}), (10 * S + 1, {MOVED: True})], MOVED),
    ],
)
def test_an_address_that_is_not_trusted_is_never_sent_to_and_keeps_no_place(
    heard: list[tuple[int, dict[tuple[str, int], bool]]], expected: tuple[str, int] | None
) -> None:
    assert observed(*heard)[0] == expected


def test_a_sender_that_moves_to_another_port_is_not_called_a_second_one() -> None:
    moves = [(0, {VEHICLE: True}), (6 * S, {MOVED: True})]
    assert observed(*moves)[1] == []
    [line] = observed(*moves, (7 * S, {VEHICLE: True}))[1]
    assert "127.0.0.1:1 and 127.0.0.1:3" in line or "127.0.0.1:3 and 127.0.0.1:1" in line
