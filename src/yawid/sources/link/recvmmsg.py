"""Datagrams from a socket: on Linux many in one system call, elsewhere one by one.

Measured with 100 datagrams waiting: 0.55 us of CPU each, with their times of arrival, against 0.93
us by ``recvfrom`` without them. Besides, each call releases the interpreter's lock and waits for it
again: with 50 vehicles, one recvmsg for each datagram costs 15 % more of a core. ``recvmmsg`` is
not in Python's socket module; its arguments and results have the layout of recvmmsg(2) and cmsg(3).
"""

import contextlib
import ctypes
import errno
import mmap
import os
import socket
import sys
from functools import lru_cache
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from yawid.blocks import Ints
from yawid.sources.link.inbox import Address

MOST = 128
"""The most datagrams taken at a time: they should be used while the caches hold them."""
_LONGEST = 65535
_SO_TIMESTAMP = 29  # Linux: each datagram has the time at which the operating system received it
_WAIT_FOR_ONE = 0x10000  # MSG_WAITFORONE: wait for the first datagram only
_DONT_WAIT = getattr(socket, "MSG_DONTWAIT", 0)
_MOST_SENDERS = 4096
_NAME_SIZE = 32  # bytes for a struct sockaddr_in6, which has 28
_NO_DATAGRAM = (errno.EAGAIN, errno.EINTR, errno.ECONNREFUSED)


class Arrivals(NamedTuple):
    """Datagrams, their senders, and times of arrival in us of the kernel's clock, 0 if none."""

    system_us: list[int]
    datagrams: list[bytes]
    senders: list[Address]


NOTHING: Final = Arrivals([], [], [])


def make_receiver(udp: socket.socket) -> "Receiver":
    """Return the receiver for a bound socket that needs the fewest calls."""
    if sys.platform == "linux":
        # Without these times a stamp may be late by the time of gathering.
        with contextlib.suppress(OSError):
            udp.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMP, 1)
        with contextlib.suppress(OSError, AttributeError):  # an old or a restricted system
            return ManyAtOnce(udp)
    return OneByOne(udp)


class OneByOne:
    """The receiver with one call for each datagram, which works on every system.

    ``can_gather`` says that datagrams can be taken without waiting for one.
    """

    def __init__(self, udp: socket.socket) -> None:
        self.can_gather = _DONT_WAIT != 0  # not on Windows
        self._socket = udp

    def receive(self, *, wait: bool = False) -> Arrivals:
        """Return the datagrams that are there, ``MOST`` at most.

        With ``wait`` it waits for the next one, and returns none after the time-out.
        """
        found, most, flags = Arrivals([], [], []), 1 if wait else MOST, 0 if wait else _DONT_WAIT
        # An error means silence, or that the other end of udpout is not there yet.
        with contextlib.suppress(BlockingIOError, TimeoutError, ConnectionError):
            while len(found.datagrams) < most:
                data, sender = self._socket.recvfrom(_LONGEST, flags)
                found.system_us.append(0)
                found.datagrams.append(data)
                found.senders.append(_address(*sender))
        return found


def _address(host: str, port: int, _flow: int = 0, scope: int = 0) -> Address:
    """Return the address from Python's sender tuple of either family."""
    return (f"{host}%{scope}" if scope and "%" not in host else host), port


_SPAN = np.dtype([("base", "P"), ("size", "P")])  # struct iovec
_HEADER = np.dtype([
    ("name", "P"), ("name_size", "u4"), ("pieces", "P"), ("n_pieces", "P"),
    ("control", "P"), ("control_size", "P"), ("flags", "i4"),
], align=True)  # fmt: skip # struct msghdr
_MESSAGE = np.dtype([("header", _HEADER), ("size", "u4")], align=True)  # struct mmsghdr
_ARRIVAL = np.dtype([
    ("length", "P"), ("level", "i4"), ("kind", "i4"), ("seconds", "l"), ("us", "l"),
], align=True)  # fmt: skip # struct cmsghdr and the struct timeval it heads


@lru_cache(_MOST_SENDERS)
def address_of(name: bytes) -> Address:
    """Return the address from a struct sockaddr_in or sockaddr_in6."""
    port = int.from_bytes(name[2:4], "big")
    if int.from_bytes(name[:2], sys.byteorder) == socket.AF_INET:
        return socket.inet_ntoa(name[4:8]), port
    scope = int.from_bytes(name[24:28], sys.byteorder)
    return _address(socket.inet_ntop(socket.AF_INET6, name[8:24]), port, 0, scope)


class ManyAtOnce:
    """The receiver for Linux, with one call for up to ``MOST`` datagrams.

    Raises:
        AttributeError: the operating system's library has no recvmmsg.
        OSError: the operating system refuses it.
    """

    can_gather = True

    def __init__(self, udp: socket.socket) -> None:
        assert sys.platform == "linux"
        self._call = ctypes.CDLL(None, use_errno=True).recvmmsg
        self._call.argtypes = [ctypes.c_int, ctypes.c_size_t, ctypes.c_uint, ctypes.c_int,
                               ctypes.c_void_p]  # fmt: skip
        self._file = udp.fileno()
        # NumPy would take huge pages, all of which are used at once.
        memory = mmap.mmap(-1, MOST * _LONGEST, mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
        data = np.frombuffer(memory, np.uint8).reshape(MOST, _LONGEST)
        names = np.zeros((MOST, _NAME_SIZE), np.uint8)
        reported, pieces = np.zeros(MOST, _ARRIVAL), np.zeros(MOST, _SPAN)
        pieces["base"], pieces["size"] = _places(data), _LONGEST
        messages = np.zeros(MOST, _MESSAGE)
        headers = messages["header"]
        headers["name"], headers["name_size"] = _places(names), _NAME_SIZE
        headers["pieces"], headers["n_pieces"] = _places(pieces), 1
        headers["control"] = _places(reported)
        self._at = messages.ctypes.data
        self._kept = pieces, messages  # the operating system has their addresses: they must stay
        # These are views of what the kernel fills in. Python reads them instead of NumPy, which is
        # faster for a few dozen rows just after waking up.
        self._view, self._sizes = data.data.cast("B"), messages["size"]
        self._names = names.view(f"V{_NAME_SIZE}")[:, 0]
        self._seconds, self._us = reported["seconds"], reported["us"]
        self._control_sizes = headers["control_size"]
        self._starts = [_LONGEST * i for i in range(MOST)]
        self._ask(0, _DONT_WAIT)  # a test of the call: it takes no datagram

    def receive(self, *, wait: bool = False) -> Arrivals:
        """Return the datagrams that are there: see :meth:`OneByOne.receive`."""
        self._control_sizes[:], self._seconds[:] = _ARRIVAL.itemsize, 0
        count = self._ask(MOST, _WAIT_FOR_ONE if wait else _DONT_WAIT)
        view, seconds = self._view, self._seconds[:count].tolist()
        times = zip(seconds, self._us[:count].tolist(), strict=True)
        places = zip(self._starts, self._sizes[:count].tolist(), strict=False)  # not all are used
        return Arrivals(
            [second and 1_000_000 * second + us for second, us in times],
            [view[start : start + size].tobytes() for start, size in places],
            list(map(address_of, self._names[:count].tolist())),
        )

    def _ask(self, most: int, flags: int) -> int:
        """Let the operating system fill in at most ``most`` datagrams; return how many it had."""
        count: int = self._call(self._file, self._at, most, flags, None)
        if count < 0:
            code = ctypes.get_errno()
            if code not in _NO_DATAGRAM:
                raise OSError(code, os.strerror(code))
        return max(count, 0)


Receiver = OneByOne | ManyAtOnce


def _places(rows: NDArray[np.generic]) -> Ints:
    """Return the memory address of each row of an array (rows,)."""
    return rows.ctypes.data + rows.strides[0] * np.arange(len(rows))
