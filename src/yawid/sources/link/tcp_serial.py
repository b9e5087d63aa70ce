"""The live tap on a stream of bytes: TCP, and serial ports as pymavlink opens them."""

import contextlib
import errno
import io
import os
import re
import socket
from typing import Any

from yawid.errors import SourceError
from yawid.sources.link.endpoints import Endpoint
from yawid.sources.link.inbox import Address
from yawid.sources.link.tap import Tap
from yawid.sources.mavlink.framing import frame_size

_READ = 4096
_HEAD = re.compile(rb"\xfe..|\xfd.[\0\1]|[\xfd\xfe].?\Z", re.DOTALL)  # the last: one that is cut
_IDLE_S = 0.005
_AGAIN_S = 2.0  # the time between attempts to get a lost connection back
_CONNECT_S = 3.0  # longer than the loss of one packet delays it; a session's end waits so long


class StreamTap(Tap):
    """A tap on ``tcp:HOST:PORT`` or a serial port; a lost connection is opened again."""

    def _open(self) -> None:
        try:
            self._connection = connect(self.endpoint)
        except OSError as error:
            raise SourceError(f"{self.endpoint} cannot be opened: {_remedy(error)}") from error
        self._peer: Address = (self.endpoint.host, self.endpoint.port)
        self._unsent = b""

    def _receive(self) -> None:
        tail = b""
        while not self._closing.is_set():
            try:
                data = self._take()
            except OSError as error:
                self.news.append(f"lost {self.endpoint} ({_remedy(error)}): trying again")
                self._reopen()
                tail = b""
                continue
            if not data:
                self._closing.wait(_IDLE_S)
                continue
            tail += data
            whole = complete_until(tail)
            if whole:
                self.inbox.put([(self.stamps.now(), tail[:whole], self._peer)])
                tail = tail[whole:]

    def _take(self) -> bytes:
        """Return the bytes received, b"" if none; an OSError means that the connection is lost."""
        try:
            data: bytes = self._connection.recv(_READ)
        except BlockingIOError:
            return b""
        if not data and self.endpoint.kind == "tcp":
            raise ConnectionResetError(errno.ECONNRESET, "closed by the other end")
        return data

    def _reopen(self) -> None:
        self._connection.close()
        while not self._closing.wait(_AGAIN_S):
            with contextlib.suppress(OSError):
                self._connection, self._unsent = connect(self.endpoint), b""
                self.news.append(f"{self.endpoint} is back")
                return

    def _send(self, frame: bytes, address: Address) -> None:
        """Send without waiting; a frame sent in part is completed before the next one."""
        self._unsent = self._unsent[self._write(self._unsent) :]
        if self._unsent:
            raise BlockingIOError(errno.EAGAIN, "the line accepts no more data")
        self._unsent = frame[self._write(frame) :]

    def _write(self, data: bytes) -> int:
        """Write as much as the connection takes without waiting; return how many bytes."""
        if not data:
            return 0
        if self.endpoint.kind == "tcp":
            return int(self._connection.send(data))
        port = self._connection.port
        if not hasattr(port, "fd"):  # Windows
            return int(port.write(data))
        return os.write(port.fileno(), data)  # pyserial's own write would wait

    def _close(self) -> None:
        self._connection.close()


def connect(endpoint: Endpoint) -> Any:
    """Return a socket connected to the endpoint, or pymavlink's serial connection.

    Raises:
        OSError: the connection cannot be opened.
        SourceError: pyserial, which serial ports need, is not installed.
    """
    if endpoint.kind == "tcp":
        link = socket.create_connection((endpoint.host, endpoint.port), _CONNECT_S)
        link.setblocking(False)
        link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        return link
    # Importing mavutil changes the environment and takes 0.1 s, so it is done only here.
    from pymavlink import mavutil

    with contextlib.redirect_stdout(io.StringIO()):  # it prints problems to stdout
        try:
            return mavutil.mavserial(endpoint.host, baud=endpoint.port)
        except ImportError as error:
            text = f"{endpoint}: serial ports need pyserial (pip install 'yawid[serial]')"
            raise SourceError(text) from error


def complete_until(data: bytes) -> int:
    """Return how many bytes from the front contain no frame that is still incomplete."""
    at = 0
    while match := _HEAD.search(data, at):
        size = frame_size(match[0])
        if size is None or match.start() + size > len(data):
            return match.start()
        at = match.start() + size
    return len(data)


def _remedy(error: OSError) -> str:
    known = {
        errno.ECONNREFUSED: "nothing listens there: start the vehicle or the router first",
        errno.ENOENT: "there is no such device",
    }
    return known.get(error.errno or 0) or error.strerror or str(error)
