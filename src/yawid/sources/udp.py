"""The live tap: datagrams in, the bytes of a tlog out. It never transmits."""

from __future__ import annotations

import errno
import re
import socket
import struct
import threading
import time
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from types import TracebackType
from typing import Self

from yawid.errors import ConfigError, SourceError
from yawid.sources.framing import frame_size

RECEIVE_BUFFER = 4 << 20
_MAX_DATAGRAM = 65535
_POLL_S = 0.1  # how long closing may take to be noticed
_OTHER_KINDS = frozenset(
    {"udp", "udpout", "udpbcast", "mcast", "tcp", "tcpin", "uds", "unix", "ws", "wss"}
)
_MAGIC = re.compile(rb"[\xfd\xfe]")
_STAMP = struct.Struct(">Q")


@dataclass(frozen=True, slots=True)
class Endpoint:
    """Where to listen: ``udpin:HOST:PORT``. Port 0 lets the system choose."""

    host: str
    port: int

    def __str__(self) -> str:
        return f"udpin:{self.host}:{self.port}"


def parse_endpoint(text: str) -> Endpoint:
    """Return the endpoint that a pymavlink connection string names.

    Raises:
        ConfigError: it is not of the form ``udpin:HOST:PORT``; the message gives the right
        spellings.
    """
    kind, _, rest = text.partition(":")
    host, _, port = rest.rpartition(":")
    if kind in _OTHER_KINDS - {"udp"} and rest:
        raise ConfigError(f"{text!r}: {kind} is not supported yet, {_spellings(port)}")
    if kind != "udpin" or not host or not port.isdecimal() or not 0 < int(port) < 65536:
        raise ConfigError(f"{text!r} does not say where to listen, {_spellings(text)}")
    return Endpoint(host, int(port))


def _spellings(text: str) -> str:
    """Give both right spellings, with the port that was meant if one can be seen."""
    match = re.search(r"(\d+)$", text)
    port = match[1] if match and 0 < int(match[1]) < 65536 else "14560"
    return (
        f"write udpin:127.0.0.1:{port} (from this machine) "
        f"or udpin:0.0.0.0:{port} (from the network)"
    )


def split_datagram(datagram: bytes) -> Iterator[bytes]:
    """Yield the MAVLink frames in a datagram, found by their headers; other bytes are left out."""
    at = 0
    while match := _MAGIC.search(datagram, at):
        at = match.start()
        size = frame_size(datagram[at : at + 3])
        if size is None or at + size > len(datagram):
            at += 1
            continue
        yield datagram[at : at + size]
        at += size


class UdpTap:
    """Listens on a UDP port of its own and hands out what it hears as tlog records.

    A thread takes datagrams off the socket, stamps and queues them; :meth:`read` turns them into
    records. All frames of a datagram carry its stamp and stamps never decrease. ``datagrams``
    counts those heard, ``dropped`` those for which the queue of ``queue_size`` had no room,
    ``skipped_bytes`` the bytes heard that are in no frame. ``receive_buffer`` is the socket's
    buffer in bytes as the system reports it.

    Raises:
        SourceError: the address cannot be listened on.
    """

    def __init__(self, endpoint: Endpoint, queue_size: int = 200_000) -> None:
        self._socket = _bound(endpoint)
        self.address: tuple[str, int] = self._socket.getsockname()
        self.receive_buffer = self._socket.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF)
        self.datagrams = 0
        self.dropped = 0
        self.skipped_bytes = 0
        self._queue: deque[tuple[int, bytes]] = deque()
        self._queue_size = queue_size
        self._arrived = threading.Event()
        self._closing = False
        self._failure: OSError | None = None
        self._thread = threading.Thread(target=self._receive, name="yawid-udp", daemon=True)
        self._thread.start()

    def read(self, timeout_s: float) -> bytes:
        """Return the records heard since the last call, waiting for the first up to ``timeout_s``.

        Raises:
            SourceError: the socket failed; what was heard before has been returned.
        """
        self._arrived.wait(timeout_s)
        self._arrived.clear()
        parts: list[bytes] = []
        while self._queue:
            stamp, datagram = self._queue.popleft()
            prefix = _STAMP.pack(stamp)
            frames = list(split_datagram(datagram))
            self.skipped_bytes += len(datagram) - sum(map(len, frames))
            for frame in frames:
                parts += (prefix, frame)
        if not parts and self._failure is not None:
            raise SourceError(f"udpin:{self.address[0]}:{self.address[1]} failed: {self._failure}")
        return b"".join(parts)

    def close(self) -> None:
        """Stop listening; what is queued can still be read."""
        self._closing = True
        self._thread.join()
        self._socket.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _receive(self) -> None:
        stamp = 0
        while not self._closing:
            try:
                datagram = self._socket.recv(_MAX_DATAGRAM)
            except TimeoutError:
                continue
            except OSError as error:
                self._failure = error
                self._arrived.set()
                return
            stamp = max(stamp, time.time_ns() // 1000)
            if len(self._queue) < self._queue_size:
                self._queue.append((stamp, datagram))
            else:
                self.dropped += 1
            self.datagrams += 1
            self._arrived.set()


def _bound(endpoint: Endpoint) -> socket.socket:
    """Return a listening socket; with SO_REUSEADDR the next program could take the port unseen."""
    tap = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        tap.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER)
        tap.settimeout(_POLL_S)
        tap.bind((endpoint.host, endpoint.port))
    except OSError as error:
        tap.close()
        raise SourceError(
            f"{endpoint} cannot be listened on: {_remedy(endpoint, error)}"
        ) from error
    return tap


def _remedy(endpoint: Endpoint, error: OSError) -> str:
    if isinstance(error, socket.gaierror) or error.errno == errno.EADDRNOTAVAIL:
        return f"{endpoint.host} is no address of this machine, use 127.0.0.1 or 0.0.0.0"
    if error.errno == errno.EADDRINUSE:
        return f"port {endpoint.port} is in use, end the program that has it or take another port"
    if error.errno == errno.EACCES:
        return f"port {endpoint.port} needs privileges, use a port above 1023"
    return error.strerror or str(error)
