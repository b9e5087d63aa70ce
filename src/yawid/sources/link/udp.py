"""The live tap on UDP: datagrams in, the bytes of a tlog out."""

import errno
import os
import socket
import struct
import time
from itertools import accumulate, islice

from yawid.errors import SourceError
from yawid.sources.link.endpoints import Endpoint
from yawid.sources.link.inbox import Address
from yawid.sources.link.receiver import MOST, NOTHING, Arrivals, Receiver
from yawid.sources.link.tap import Tap

RECEIVE_BUFFER = 4 << 20
GATHER_S = 0.04
"""The time in which datagrams gather before they are taken: waking up for each costs the most."""
_MOST_WAITING = 2 * RECEIVE_BUFFER // 832  # datagrams in the buffer, each of which takes 832 bytes
_DENSEST = 832 * 200_000  # the buffer's bytes that a flood takes in a second, 832 for a datagram
# How long closing may take to be noticed; Python's own timeout takes two system calls.
_POLL = struct.pack("@ll", 0, 100_000) if os.name == "posix" else struct.pack("@I", 100)
_AT_ONCE = getattr(socket, "MSG_DONTWAIT", 0)
_SO_MEMINFO = 55  # Linux: nine counts of a socket; the last is the one SO_RXQ_OVFL reports
_MEMINFO = struct.Struct("9I")


class UdpTap(Tap):
    """A tap on udpin, udpout, udpbcast or mcast; ``address`` is where its socket is bound."""

    def _open(self) -> None:
        self._socket = open_socket(self.endpoint)
        host, port, *_ = self._socket.getsockname()
        self.address: Address = host, port
        self._receiver = Receiver(self._socket)
        self.receive_buffer: int = self._socket.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF)
        self._dropped_at_close: int | None = None

    @property
    def socket_dropped(self) -> int | None:
        """The number of datagrams that the operating system dropped, None where unknown."""
        return self._dropped_at_close if self._closing.is_set() else dropped_by(self._socket)

    def _receive(self) -> None:
        """Take datagrams until closed: let them gather, then take all; wait if there are none."""
        # The buffer must hold even a flood in the time of gathering.
        longest_s = gather_s = min(GATHER_S, self.receive_buffer / _DENSEST)
        count, receiver = 0, self._receiver
        while not self._closing.is_set():
            first = NOTHING if count else receiver.receive(wait=True)
            if receiver.can_gather and (count or first.datagrams):
                time.sleep(gather_s)
            count = self._put(first) + self._take()
            gather_s = min(longest_s, gather_s * MOST / max(count, 1))
        self._take()

    def _take(self) -> int:
        """Queue what is there, at most what the socket's buffer holds; return how many."""
        count = 0
        while self._receiver.can_gather and count < _MOST_WAITING:
            taken = self._put(self._receiver.receive())
            count += taken
            if taken < MOST:
                break
        return count

    def _put(self, arrived: Arrivals) -> int:
        """Queue datagrams with their stamps; return how many there are.

        A stamp is the time at which the operating system received the datagram; stamps never
        decrease. Since the operating system's clock may have been set, its time is only believed
        between the previous stamp and now.
        """
        now_us, ahead_us = self.stamps.now(), self.stamps.ahead_ns() // 1000
        times = (min(us - ahead_us, now_us) if us else now_us for us in arrived.system_us)
        stamps = islice(accumulate(times, max, initial=self.inbox.last_us), 1, None)
        if rows := list(zip(stamps, arrived.datagrams, arrived.senders, strict=True)):
            self.inbox.put(rows)
        return len(rows)

    def _send(self, frame: bytes, address: Address) -> None:
        self._socket.sendto(frame, _AT_ONCE, address)

    def _destination(self, sysid: int) -> Address:
        if self.endpoint.kind == "udpout":
            return self._socket.getpeername()  # type: ignore[no-any-return] # untyped: (host, port)
        return super()._destination(sysid)

    def _close(self) -> None:
        self._dropped_at_close = dropped_by(self._socket)
        self._socket.close()


def dropped_by(tap: socket.socket) -> int | None:
    """Return how many datagrams the kernel dropped for lack of room, None where unknown."""
    try:
        counts = _MEMINFO.unpack(tap.getsockopt(socket.SOL_SOCKET, _SO_MEMINFO, _MEMINFO.size))
    except (OSError, struct.error):
        return None
    return int(counts[-1])


def open_socket(endpoint: Endpoint) -> socket.socket:
    """Return a socket that receives at the endpoint.

    Raises:
        SourceError: the address cannot be listened on; the message gives the remedy.
    """
    family = socket.AF_INET6 if endpoint.is_ipv6 else socket.AF_INET
    tap = None
    try:
        tap = socket.socket(family, socket.SOCK_DGRAM)
        tap.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER)
        tap.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, _POLL)
        if endpoint.kind == "udpout":
            tap.connect((endpoint.host, endpoint.port))
        elif endpoint.kind == "mcast":
            # Every listener of a group receives everything: here the port is meant to be shared.
            tap.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            tap.bind((endpoint.host if os.name == "posix" else "", endpoint.port))
            group = socket.inet_aton(endpoint.host) + socket.inet_aton("0.0.0.0")
            tap.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, group)
        else:
            if endpoint.is_ipv6:  # [::] must not open 0.0.0.0 as well
                tap.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 1)
            # There is no SO_REUSEADDR: with it another program could take the port unnoticed.
            tap.bind((endpoint.host, endpoint.port))
    except OSError as error:
        if tap is not None:
            tap.close()
        text = f"cannot listen on {endpoint}: {_remedy(endpoint, error)}"
        raise SourceError(text) from error
    return tap


def _remedy(endpoint: Endpoint, error: OSError) -> str:
    unknown = isinstance(error, socket.gaierror) or error.errno == errno.EADDRNOTAVAIL
    if unknown and endpoint.kind == "udpin":
        own = "::1 or ::" if endpoint.is_ipv6 else "127.0.0.1 or 0.0.0.0"
        return f"{endpoint.host} is not an address of this machine: use {own}"
    port = f"port {endpoint.port}"
    known = {
        errno.EADDRINUSE: f"{port} is in use: end the program that has it, or use another port",
        errno.EAFNOSUPPORT: "this machine has no IPv6: use an address such as 127.0.0.1",
        errno.EACCES: f"{port} needs privileges: use a port above 1023",
    }
    return known.get(error.errno or 0) or error.strerror or str(error)
