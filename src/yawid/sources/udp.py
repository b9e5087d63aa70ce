"""The live tap on UDP: datagrams in, the bytes of a tlog out."""

from __future__ import annotations

import contextlib
import errno
import os
import socket
import struct
import sys
import time

from yawid.errors import SourceError
from yawid.sources.endpoints import Endpoint
from yawid.sources.inbox import Address, Heard
from yawid.sources.tap import Tap

RECEIVE_BUFFER = 4 << 20
GATHER_S = 0.035
"""So long datagrams gather before they are taken: to wake up for each costs more than all else."""
_GATHERED = 128  # about so many at a time: they are to be taken while the caches hold them
_DENSEST = 832 * 200_000  # bytes a second of the system's buffer that a flood takes: 832 a datagram
_MAX_DATAGRAM = 65535
_DONT_WAIT = getattr(socket, "MSG_DONTWAIT", 0)
_CAN_GATHER = _DONT_WAIT != 0 and hasattr(socket.socket, "recvmsg")  # elsewhere than on Windows
_SO_TIMESTAMP = 29  # Linux: each datagram comes with the time at which the system had it
_TIMEVAL = struct.Struct("@ll")
# How long closing may take to be noticed; Python's own timeout would call the system twice.
_POLL = struct.pack("@ll", 0, 100_000) if os.name == "posix" else struct.pack("@I", 100)
_SO_MEMINFO = 55  # Linux: nine counts of a socket; the last is the one SO_RXQ_OVFL reports
_MEMINFO = struct.Struct("9I")
_ANCILLARY = 64  # bytes: room for the time and what else the system may tell of a datagram

Arrived = tuple[bytes, list[tuple[int, int, bytes]], int, Address]
"""A datagram, what the system told of it (its time), flags, and its sender."""


class UdpTap(Tap):
    """A tap on udpin, udpout, udpbcast or mcast; ``address`` is where its socket is bound."""

    def _open(self) -> None:
        self._socket = open_socket(self.endpoint)
        self.address: Address = self._socket.getsockname()
        if sys.platform == "linux":
            with contextlib.suppress(OSError):  # without it a stamp may be late by the gathering
                self._socket.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMP, 1)
        self.receive_buffer: int = self._socket.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF)
        self._dropped_at_close: int | None = None
        self._one = self._socket.recvmsg if _CAN_GATHER else self._recvfrom

    @property
    def socket_dropped(self) -> int | None:
        """How many datagrams the system had no room for; None where it does not say."""
        return self._dropped_at_close if self._closing.is_set() else dropped_by(self._socket)

    def _receive(self) -> None:
        """Take datagrams until closed: they gather, then all are taken; wait where none come."""
        # Even a flood must find room while nobody looks.
        longest_s = gather_s = min(GATHER_S, self.receive_buffer / _DENSEST)
        count = 0
        while not self._closing.is_set():
            heard: list[Arrived] = []
            if not count:
                # Silence, or the other end of udpout is not there yet.
                with contextlib.suppress(BlockingIOError, TimeoutError, ConnectionRefusedError):
                    heard.append(self._one(_MAX_DATAGRAM, _ANCILLARY, 0))
            if _CAN_GATHER and (heard or count):
                time.sleep(gather_s)
            count = self._take(heard)
            gather_s = min(longest_s, gather_s * _GATHERED / max(count, 1))
        self._take([])

    def _take(self, heard: list[Arrived]) -> int:
        """Stamp and queue what was ``heard`` and all that is there; return how many there were."""
        is_more, count, one = _CAN_GATHER, 0, self._one
        while is_more or heard:
            try:
                while is_more and len(heard) < _GATHERED:
                    heard.append(one(_MAX_DATAGRAM, _ANCILLARY, _DONT_WAIT))
            except (BlockingIOError, ConnectionRefusedError):
                is_more = False
            if heard:
                self._inbox.put(self._stamped(heard))
            count += len(heard)
            heard = []
        return count

    def _recvfrom(self, size: int, _: int, flags: int) -> Arrived:
        """Take one datagram where the system has no recvmsg."""
        data, address = self._socket.recvfrom(size, flags)
        return data, [], 0, address

    def _stamped(self, heard: list[Arrived]) -> list[Heard]:
        """Return datagrams with their stamps: when the system had them, never decreasing.

        The system's clock may have been set since then, its time is believed only between the
        stamp before and now.
        """
        last_us, now_us, ahead_us = self._inbox.last_us, self.stamps.now(), self.stamps.ahead_us()
        stamped = []
        for data, told, _, address in heard:
            arrived_us = now_us
            if told and len(told[0][2]) == _TIMEVAL.size:
                seconds, us = _TIMEVAL.unpack(told[0][2])
                arrived_us = seconds * 1_000_000 + us - ahead_us
                if arrived_us > now_us:
                    arrived_us = now_us
            if arrived_us > last_us:
                last_us = arrived_us
            stamped.append((last_us, data, address))
        return stamped

    def _send(self, frame: bytes, address: Address) -> None:
        self._socket.sendto(frame, address)

    def _destination(self, sysid: int) -> Address | None:
        if self.endpoint.kind == "udpout":
            return self._socket.getpeername()  # type: ignore[no-any-return] # untyped: (host, port)
        return super()._destination(sysid)

    def _close(self) -> None:
        self._dropped_at_close = dropped_by(self._socket)
        self._socket.close()


def dropped_by(tap: socket.socket) -> int | None:
    """Return how many datagrams the system dropped for want of room, None where it does not say."""
    try:
        counts = _MEMINFO.unpack(tap.getsockopt(socket.SOL_SOCKET, _SO_MEMINFO, _MEMINFO.size))
    except (OSError, struct.error):
        return None
    return int(counts[-1])


def open_socket(endpoint: Endpoint) -> socket.socket:
    """Return a socket that hears the endpoint.

    Raises:
        SourceError: the address cannot be listened on; the message gives the remedy.
    """
    tap = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        tap.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER)
        tap.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, _POLL)
        if endpoint.kind == "udpout":
            tap.connect((endpoint.host, endpoint.port))
        elif endpoint.kind == "mcast":
            # Every listener of a group hears all of it: here the port is meant to be shared.
            tap.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            tap.bind((endpoint.host, endpoint.port))
            group = socket.inet_aton(endpoint.host) + socket.inet_aton("0.0.0.0")
            tap.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, group)
        else:
            # No SO_REUSEADDR: with it the next program could take the port unseen.
            tap.bind((endpoint.host, endpoint.port))
    except OSError as error:
        tap.close()
        text = f"{endpoint} cannot be listened on: {_remedy(endpoint, error)}"
        raise SourceError(text) from error
    return tap


def _remedy(endpoint: Endpoint, error: OSError) -> str:
    unknown = isinstance(error, socket.gaierror) or error.errno == errno.EADDRNOTAVAIL
    if unknown and endpoint.kind == "udpin":
        return f"{endpoint.host} is no address of this machine, use 127.0.0.1 or 0.0.0.0"
    if error.errno == errno.EADDRINUSE:
        return f"port {endpoint.port} is in use, end the program that has it or take another port"
    if error.errno == errno.EACCES:
        return f"port {endpoint.port} needs privileges, use a port above 1023"
    return error.strerror or str(error)
