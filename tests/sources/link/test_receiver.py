"""Datagrams from a real socket: with and without their times they are the same datagrams."""

from __future__ import annotations

import socket
import struct
import sys
import time
from collections.abc import Iterator
from functools import partial

import numpy as np
import pytest

from yawid.sources.link.receiver import MOST, NOTHING, Receiver

SIZES = [1, 0, 75, 280, 1472, 9000, 65507]


@pytest.fixture
def hearing() -> Iterator[socket.socket]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as udp:
        udp.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4 << 20)
        udp.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, struct.pack("@ll", 0, 100_000))
        udp.bind(("127.0.0.1", 0))
        yield udp


@pytest.fixture
def vehicles() -> Iterator[list[socket.socket]]:
    links = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2)]
    yield links
    for link in links:
        link.close()


@pytest.mark.parametrize("has_time", [True, False])
def test_datagrams_of_any_size_come_whole_in_order_and_with_their_senders(
    has_time: bool, hearing: socket.socket, vehicles: list[socket.socket]
) -> None:
    rng = np.random.default_rng(0)
    sent = []
    for i in range(3 * MOST // 2):
        link, data = vehicles[i % 2], rng.bytes(SIZES[i % len(SIZES)])
        link.sendto(data, hearing.getsockname())
        sent.append((data, ("127.0.0.1", link.getsockname()[1])))
    receiver = made(hearing, has_time=has_time)
    assert [(data, sender) for _, data, sender in everything(receiver)] == sent


@pytest.mark.parametrize("has_time", [True, False])
def test_silence_and_a_peer_that_is_not_there_yet_are_no_datagrams(
    has_time: bool, hearing: socket.socket
) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as gone:
        gone.bind(("127.0.0.1", 0))
        nobody = gone.getsockname()
    receiver = made(hearing, has_time=has_time)
    assert receiver.receive(wait=True) == receiver.receive() == NOTHING
    hearing.connect(nobody)
    for ask in (partial(receiver.receive, wait=True), receiver.receive):
        hearing.send(b"anyone there?")
        assert ask() == NOTHING


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux tells when a datagram arrived")
def test_the_time_told_is_when_the_system_had_the_datagram(
    hearing: socket.socket, vehicles: list[socket.socket]
) -> None:
    receiver = Receiver(hearing)
    until_it_tells(receiver, hearing, vehicles[0])
    before_us = time.time_ns() // 1000
    for link in vehicles:
        link.sendto(b"now", hearing.getsockname())
    after_us = time.time_ns() // 1000
    time.sleep(0.05)
    times = [told_us for told_us, _, _ in everything(receiver)]
    assert len(times) == 2
    clock_us = 200  # two clocks are read one after the other
    assert before_us - clock_us <= times[0] <= times[1] <= after_us + clock_us


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux tells when a datagram arrived")
def test_a_time_the_system_does_not_tell_is_not_the_one_before(
    hearing: socket.socket, vehicles: list[socket.socket]
) -> None:
    receiver = Receiver(hearing)
    vehicles[0].sendto(b"told", hearing.getsockname())
    assert everything(receiver)[0][0] > 0
    hearing.setsockopt(socket.SOL_SOCKET, 29, 0)
    vehicles[0].sendto(b"not told", hearing.getsockname())
    assert [(told_us, data) for told_us, data, _ in everything(receiver)] == [(0, b"not told")]


def made(udp: socket.socket, *, has_time: bool) -> Receiver:
    """Return the receiver of a system that has times of arrival, or of one that has none."""
    receiver = Receiver(udp)
    receiver._has_time &= has_time
    return receiver


def until_it_tells(receiver: Receiver, hearing: socket.socket, link: socket.socket) -> None:
    """Wait until the system takes the time of arrivals: it begins a moment after it is asked to."""
    for _ in range(100):
        link.sendto(b"hello", hearing.getsockname())
        sent_us = time.time_ns() // 1000
        time.sleep(0.005)
        if everything(receiver)[0][0] < sent_us + 1000:
            return
    raise AssertionError("the system tells when a datagram is taken, not when it came")


def everything(receiver: Receiver) -> list[tuple[int, bytes, tuple[str, int]]]:
    """Wait for the first, then take what there is."""
    heard = list(zip(*receiver.receive(wait=True), strict=True))
    while more := list(zip(*receiver.receive(), strict=True)):
        heard += more
    return heard
