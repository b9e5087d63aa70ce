"""The live tap on UDP: datagrams in, the bytes of a tlog out."""

from __future__ import annotations

import errno
import os
import socket
import struct
import time

from yawid.errors import SourceError
from yawid.sources.endpoints import Endpoint
from yawid.sources.inbox import Address
from yawid.sources.tap import Tap

RECEIVE_BUFFER = 4 << 20
_MAX_DATAGRAM = 65535
_THICK_US = 200  # datagrams closer than this are worth gathering: to wake up for each costs more
_GATHER_S = 0.001
_DONT_WAIT = getattr(socket, "MSG_DONTWAIT", 0)
# How long closing may take to be noticed; Python's own timeout would call the system twice.
_POLL = struct.pack("@ll", 0, 100_000) if os.name == "posix" else struct.pack("@I", 100)
_SO_MEMINFO = 55  # Linux: nine counts of a socket; the last is the one SO_RXQ_OVFL reports
_MEMINFO = struct.Struct("9I")


class UdpTap(Tap):
    """A tap on udpin, udpout, udpbcast or mcast; ``address`` is where its socket is bound."""

    def _open(self) -> None:
        self._socket = open_socket(self.endpoint)
        self.address: Address = self._socket.getsockname()
        self.receive_buffer = self._socket.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF)
        self._dropped_at_close: int | None = None

    @property
    def socket_dropped(self) -> int | None:
        """How many datagrams the system had no room for; None where it does not say."""
        return self._dropped_at_close if self._closing.is_set() else dropped_by(self._socket)

    def _receive(self) -> None:
        """Take datagrams until closed; where they come thick, let some gather and take them all."""
        put, recvfrom = self._inbox.put, self._socket.recvfrom
        before_us = 0
        while not self._closing.is_set():
            try:
                now_us = put(*recvfrom(_MAX_DATAGRAM))
                is_thick, before_us = now_us - before_us < _THICK_US, now_us
                if is_thick:
                    time.sleep(_GATHER_S)
                    while True:
                        before_us = put(*recvfrom(_MAX_DATAGRAM, _DONT_WAIT))
            except (BlockingIOError, TimeoutError, ConnectionRefusedError):
                continue  # silence, or the other end of udpout is not there yet

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
