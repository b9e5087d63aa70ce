"""What all taps have in common: a thread that receives, a queue, and tlog records to be read."""

import re
import struct
import threading
import time
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Iterator
from typing import Self

from yawid.errors import SourceError
from yawid.sources.link.endpoints import Endpoint
from yawid.sources.link.inbox import MOST_AT_ONCE, QUEUE, Address, Addresses, Inbox, Stamps
from yawid.sources.mavlink.framing import MAGIC_V1, frame_size
from yawid.sources.mavlink.signing import SigningKey

BATCH_S = 0.035  # the time between reads: a call of the decoder costs as much as 200 frames in it
_HEAD = re.compile(rb"\xfe..|\xfd.[\0\1]", re.DOTALL)
"""The heads for which ``frame_size`` gives a size; calling it at every byte would take a second."""
_STAMP = struct.Struct(">Q")


class Tap(ABC):
    """A listener on one endpoint that returns what it receives as tlog records.

    A thread takes datagrams, stamps and queues them; :meth:`read` makes records from them. All
    frames of a datagram have its stamp, and stamps never decrease. ``inbox`` counts the datagrams
    received and those for which its ``queue_size`` had no room, ``skipped_bytes`` the bytes outside
    frames. ``senders`` has the addresses of the systems; ``news`` has lines about the link that
    have not been reported yet. With ``key`` only frames signed with it decide to which address
    frames for a vehicle are sent.

    Raises:
        SourceError: the endpoint cannot be opened.
    """

    receive_buffer: int | None = None
    """The size of the socket's buffer in bytes by the operating system, None where unknown."""

    def __init__(
        self,
        endpoint: Endpoint,
        queue_size: int = QUEUE,
        *,
        may_transmit: bool = False,
        stamps: Stamps | None = None,
        key: SigningKey | None = None,
    ) -> None:
        self.endpoint = endpoint
        self.may_transmit = may_transmit
        self.skipped_bytes = 0
        self.stamps = stamps or Stamps()
        self.senders = Addresses()
        self.news: deque[str] = deque()
        self.inbox = Inbox(queue_size)
        self.pause_s = BATCH_S
        self._next_read_s = 0.0
        self._key = key
        self._closing = threading.Event()
        self._failure: Exception | None = None
        self._open()
        self._thread = threading.Thread(target=self._run, name="yawid-tap", daemon=True)
        self._thread.start()

    @abstractmethod
    def _open(self) -> None:
        """Open the socket or device."""

    @abstractmethod
    def _receive(self) -> None:
        """Put received data into the inbox until closing; an OSError ends the tap."""

    @abstractmethod
    def _send(self, frame: bytes, address: Address) -> None:
        """Send a frame; an OSError means that it was not sent."""

    @abstractmethod
    def _close(self) -> None:
        """Close the socket or device; the thread has ended by then."""

    @property
    def socket_dropped(self) -> int | None:
        """The number of datagrams that the operating system dropped, None where unknown."""
        return None

    def reached_us(self) -> int:
        """Return the stamp up to which everything received has been read: now if nothing waits."""
        oldest_us = self.inbox.oldest_us
        return self.stamps.now() if oldest_us is None else oldest_us

    def read(self, timeout_s: float) -> bytes:
        """Return the records received since the last call; wait for the first up to ``timeout_s``.

        Reads are kept ``pause_s`` apart while datagrams keep coming, so that one call takes many;
        a call that comes much too early returns nothing. A backlog is taken without a pause.

        Raises:
            SourceError: the endpoint failed; what was received before has been returned.
        """
        if self.inbox.arrived.wait(timeout_s) and not self._closing.is_set():
            early_s = self._next_read_s - time.monotonic()
            if early_s > 0.0 and len(self.inbox) < MOST_AT_ONCE:
                time.sleep(min(early_s, max(timeout_s, BATCH_S)))
                if early_s > max(timeout_s, BATCH_S):
                    return b""
            self._next_read_s = time.monotonic() + self.pause_s
        parts: list[bytes] = []
        pairs: dict[tuple[int, Address], bool] = {}
        stamp, pack = 0, _STAMP.pack
        for stamp, datagram, address in self.inbox.get():
            prefix, frames = pack(stamp), [datagram]
            if frame_size(datagram) != len(datagram):
                frames = list(split_datagram(datagram))
                self.skipped_bytes += len(datagram) - sum(map(len, frames))
            for frame in frames:
                parts += (prefix, frame)
                pair = sysid_of(frame), address
                if not pairs.get(pair):  # whether one of its frames is signed, if there is a key
                    pairs[pair] = self._key is None or self._key.has_signed(frame)
        self.news.extend(self.senders.observe(pairs, stamp))
        if not parts and self._failure is not None:
            kind = "" if isinstance(self._failure, OSError) else f"{type(self._failure).__name__}: "
            raise SourceError(f"{self.endpoint} failed: {kind}{self._failure}")
        return b"".join(parts)

    def transmit(self, frame: bytes, sysid: int) -> bool:
        """Send a frame to the address of ``sysid`` (see ``senders``); return whether it was sent.

        Raises:
            RuntimeError: the tap was not opened to transmit.
        """
        if not self.may_transmit:
            raise RuntimeError("a passive tap does not transmit")
        try:
            self._send(frame, self._destination(sysid))
        except (OSError, KeyError):
            return False  # like a lost datagram: the request has no answer and is repeated
        return True

    def _destination(self, sysid: int) -> Address:
        return self.senders.first[sysid]

    def close(self) -> None:
        """Stop listening; what is queued can still be read."""
        if not self._closing.is_set():
            self._closing.set()
            self._thread.join()
            self._close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _run(self) -> None:
        try:
            self._receive()
        except Exception as error:  # raised by read(); a thread would print a traceback
            self._failure = error
            self.inbox.arrived.set()


def split_datagram(datagram: bytes) -> Iterator[bytes]:
    """Yield the MAVLink frames in a datagram, found by their headers; other bytes are left out."""
    at = 0
    while match := _HEAD.search(datagram, at):
        at = match.start()
        size = frame_size(match[0])
        if size is None or at + size > len(datagram):
            at += 1
            continue
        yield datagram[at : at + size]
        at += size


def sysid_of(frame: bytes) -> int:
    """Return the system id in a frame's header."""
    return frame[3] if frame[0] == MAGIC_V1 else frame[5]
