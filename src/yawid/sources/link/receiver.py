"""Datagrams off a socket, each with its sender and, on Linux, the time at which it arrived."""

import contextlib
import socket
import struct
import sys
from typing import Any, Final, NamedTuple

from yawid.sources.link.inbox import Address

MOST = 128
"""So many are taken at a time: they are to be used while the caches hold them."""
_LONGEST = 65535
_SO_TIMESTAMP = 29  # Linux: each datagram comes with the time at which the operating system had it
_HAS_TIME = sys.platform == "linux"
_TIME = struct.Struct("@ll")  # struct timeval
_ROOM = 64  # bytes for it and the header before it
_DONT_WAIT = getattr(socket, "MSG_DONTWAIT", 0)


class Arrivals(NamedTuple):
    """Datagrams, when the kernel had each (us of its clock, 0: it does not say), and from whom."""

    system_us: list[int]
    datagrams: list[bytes]
    senders: list[Address]


_Datagram = tuple[bytes, Any, int, Any]
"""As ``recvmsg`` returns it: the bytes, what the system reports of them, flags, the sender."""
NOTHING: Final = Arrivals([], [], [])


class Receiver:
    """What takes datagrams off a bound socket.

    ``can_gather``: those there are can be taken without waiting for one.
    """

    def __init__(self, udp: socket.socket) -> None:
        self.can_gather = _DONT_WAIT != 0  # not on Windows
        self._socket = udp
        self._next = _without_time(udp)
        if _HAS_TIME:
            # Without the time a stamp may be late by the gathering.
            with contextlib.suppress(OSError):
                udp.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMP, 1)
                self._next = udp.recvmsg

    def wait(self) -> Arrivals:
        """Return the next datagram; none after the socket's time-out."""
        # Silence, or the other end of udpout is not there yet.
        with contextlib.suppress(BlockingIOError, TimeoutError, ConnectionRefusedError):
            return _arrivals([self._next(_LONGEST, _ROOM)])
        return NOTHING

    def get(self) -> Arrivals:
        """Return what is there, ``MOST`` at most."""
        take = self._next
        received: list[_Datagram] = []
        with contextlib.suppress(BlockingIOError, ConnectionRefusedError):
            while len(received) < MOST:
                received.append(take(_LONGEST, _ROOM, _DONT_WAIT))
        return _arrivals(received) if received else NOTHING


def _without_time(udp: socket.socket) -> Any:
    """Return what stands in for ``recvmsg`` where a system has none or does not tell the time."""

    def take(size: int, _room: int, flags: int = 0) -> _Datagram:
        data, sender = udp.recvfrom(size, flags)
        return data, (), 0, sender

    return take


def _arrivals(received: list[_Datagram]) -> Arrivals:
    return Arrivals(
        [_time_us(reported) for _, reported, _, _ in received],
        [data for data, *_ in received],
        [_address(*sender) for *_, sender in received],
    )


def _time_us(reported: list[tuple[int, int, bytes]]) -> int:
    """Return the time that came along with a datagram, 0 without."""
    for level, kind, data in reported:
        if (level, kind, len(data)) == (socket.SOL_SOCKET, _SO_TIMESTAMP, _TIME.size):
            seconds, us = _TIME.unpack(data)
            return int(1_000_000 * seconds + us)
    return 0


def _address(host: str, port: int, _flow: int = 0, scope: int = 0) -> Address:
    """Return what Python calls a sender of either family as an address."""
    return (f"{host}%{scope}" if scope and "%" not in host else host), port
