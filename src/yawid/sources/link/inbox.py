"""What is between the receiving and the computing thread: stamps, a queue, and the senders."""

import threading
import time
from bisect import bisect_right
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from itertools import accumulate, chain

from yawid.sources.link.endpoints import written
from yawid.system.processes import steady_ns

Address = tuple[str, int]
"""Host and port; a link-local IPv6 host has the number of its link: ``fe80::1%2``."""
Arrived = tuple[int, bytes, Address]
"""The stamp of a datagram, itself, and its sender."""
QUEUE, QUEUE_BYTES = 200_000, 64 << 20
"""The most datagrams, and bytes of them, that may wait: more than a minute of a busy link."""
LONGEST = 9000
"""The longest datagram accepted, in bytes: a jumbo frame, thirty of MAVLink's longest frames."""
JUMP_S = 1.0
"""The least jump of the wall clock, in s, that is reported."""
MOST_AT_ONCE = 32_768
"""The most datagrams of one read: a second of 250 vehicles; a backlog must not fill the memory."""
MOST_BYTES_AT_ONCE = 1 << 20
"""The most bytes of one read: hostile ones take a second to search, and a stop must not wait
longer."""
SILENT_US = 10_000_000
"""The silence of a system's address after which another address replaces it."""
TOGETHER_US = 5_000_000
"""Two addresses received within this time of each other are two senders, not one that moved."""


class Stamps:
    """Receive stamps in us of Unix time: from the wall clock once, then from a steady clock.

    If the wall clock is set during a session, the stamps must not jump: they go on evenly, and
    :meth:`jump` returns by how much the wall clock has moved away from them.
    """

    def __init__(
        self, wall_ns: Callable[[], int] = time.time_ns, steady_ns: Callable[[], int] = steady_ns
    ) -> None:
        self._wall_ns, self._steady_ns = wall_ns, steady_ns
        self._base_ns = wall_ns() - steady_ns()
        self._reported_ns = 0

    def now(self) -> int:
        """Return the stamp of this instant."""
        return (self._base_ns + self._steady_ns()) // 1000

    def ahead_ns(self) -> int:
        """Return by how many ns the wall clock is ahead of the stamps now."""
        return self._wall_ns() - self._steady_ns() - self._base_ns

    def jump(self) -> float | None:
        """Return the wall clock's jump in s since the last one returned, None without one."""
        ahead_ns = self.ahead_ns()
        moved_s = (ahead_ns - self._reported_ns) / 1e9
        if abs(moved_s) < JUMP_S:
            return None
        self._reported_ns = ahead_ns
        return moved_s


class Inbox:
    """A queue of datagrams with their stamps and senders, bounded in datagrams and in bytes.

    ``received`` counts all datagrams, ``dropped`` those for which there was no room, ``too_long``
    those of more than ``LONGEST`` bytes and ``skipped`` those that :meth:`skip` removed. One thread
    puts them in, another takes them and waits for ``arrived``; ``last_us`` is the stamp of the
    newest one received, 0 before.
    """

    def __init__(self, size: int, most_bytes: int = QUEUE_BYTES) -> None:
        self.received = 0
        self.dropped = 0
        self.too_long = 0
        self.skipped = 0
        self.last_us = 0
        self._size, self._most_bytes = size, most_bytes
        self._taken = 0
        # Each is counted by one thread only: the queue holds the difference.
        self._bytes_put = self._bytes_taken = 0
        self._queue: deque[list[Arrived]] = deque()
        self.arrived = threading.Event()

    def __len__(self) -> int:
        # The other thread is counting: for an instant "dropped" may be ahead of "received".
        return max(self.received - self.dropped - self.too_long - self._taken, 0)

    @property
    def oldest_us(self) -> int | None:
        """The stamp of the oldest datagram that waits, None without any; for the taking thread."""
        return self._queue[0][0][0] if self._queue else None

    def put(self, arrived: list[Arrived]) -> None:
        """Queue the datagrams, n >= 1, for which there is room; count the others."""
        self.last_us = arrived[-1][0]
        fits = [each for each in arrived if len(each[1]) <= LONGEST]
        sizes = list(accumulate(len(datagram) for _, datagram, _ in fits))
        room = bisect_right(sizes, self._most_bytes - self._waiting_bytes)
        taken = fits[: min(max(self._size - len(self), 0), room)]
        self.too_long += len(arrived) - len(fits)
        self.dropped += len(fits) - len(taken)
        if taken:
            self._bytes_put += sizes[len(taken) - 1]
            self._queue.append(taken)
        self.received += len(arrived)
        self.arrived.set()

    @property
    def _waiting_bytes(self) -> int:
        return self._bytes_put - self._bytes_taken

    def get(self) -> Iterator[Arrived]:
        """Return what is queued, the oldest first, up to a bound."""
        self.arrived.clear()
        taken, count, size = [], 0, 0
        while self._queue and count < MOST_AT_ONCE and size < MOST_BYTES_AT_ONCE:
            taken.append(self._queue.popleft())
            count += len(taken[-1])
            size += sum(len(datagram) for _, datagram, _ in taken[-1])
        self._taken += count
        self._bytes_taken += size
        if self._queue:
            self.arrived.set()
        return chain.from_iterable(taken)

    def skip(self) -> int:
        """Remove and count all that waits; return its bytes. No thread may put any more."""
        left = self._waiting_bytes
        self.skipped, self._bytes_taken = len(self), self._bytes_put
        self._taken += self.skipped
        self._queue.clear()
        return left


class Addresses:
    """The addresses of every system id; ``first`` has the one to send to.

    This is the address that was received first, until it has been silent for ``SILENT_US``: a later
    sender that claims to be the same system gets nothing.
    """

    def __init__(self) -> None:
        self.first: dict[int, Address] = {}
        self._first_us: dict[int, int] = {}
        self._received_us: dict[int, dict[Address, int]] = {}
        self._reported: set[int] = set()

    def observe(self, pairs: Mapping[tuple[int, Address], bool], now_us: int) -> list[str]:
        """Take in the (system id, address) pairs since the last call, oldest first; return news.

        The values say whether an address may become ``first``. A system id from two addresses at
        once is reported one time. An address that replaces a silent one is a restarted sender, and
        is not reported.
        """
        news = []
        for (sysid, address), is_trusted in pairs.items():
            if is_trusted:
                if now_us - self._first_us.get(sysid, -SILENT_US) >= SILENT_US:
                    self.first[sysid] = address
                if self.first[sysid] == address:
                    self._first_us[sysid] = now_us
            if sysid in self._reported:
                continue
            known = self._received_us.setdefault(sysid, {})
            known[address] = now_us
            for old in [a for a, us in known.items() if now_us - us > TOGETHER_US]:
                del known[old]
            if len(known) > 1:
                self._reported.add(sysid)
                del self._received_us[sysid]
                places = " and ".join(written(*place) for place in known)
                news.append(
                    f"system {sysid} is received from two addresses, {places}: its stream is "
                    "forged or doubled, or two vehicles have one id; both are recorded and "
                    "estimated"
                )
        return news
