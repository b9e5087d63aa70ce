"""The decoder: bytes of a tlog in; messages as columns, and counts of everything, out."""

from collections.abc import Iterable
from functools import cache
from typing import Any

import numpy as np

from yawid.blocks import Array, Bytes, FrameBlock, Ints, MessageBlock
from yawid.quantities.link import LinkStats
from yawid.sources.mavlink.definitions import definitions, dtype_of
from yawid.sources.mavlink.framing import SLACK, STAMP_SIZE, Frames, find_frames
from yawid.sources.mavlink.resync import Chain, StampFilter, Stretch, stamps_of
from yawid.sources.mavlink.sequence import Records
from yawid.sources.mavlink.signing import Signing
from yawid.sources.mavlink.tally import Tally

_LARGE = 1 << 20
_SEQUENCE_AT = np.array([0] * 6 + [2] + [0] * 3 + [4])  # by size of the header
_NO_FRAMES = Frames(*(np.empty(0, np.int64) for _ in range(5)))


class Decoder:
    """The decoder of a tlog's bytes into messages; where the bytes are cut changes nothing.

    A record is an 8-byte big-endian stamp in microseconds and a MAVLink 1 or 2 frame. Every record
    whose stamp and frame are intact is found, whatever is around it, and none is invented: see
    ``resync`` for the rules. Two kinds of damage cannot be seen: a stamp that is still within 3
    days of its neighbours, and a frame whose damage happens to match the 16 bits of CRC. The first
    record of all is returned with the second, which confirms its stamp. With ``signing`` only the
    frames that it accepts are returned; of a frame that came over two links, the first. Hostile
    bytes need thirty times as much memory as are fed at once.

    Raises:
        ConfigError: a name in ``wanted`` is no message of the dialect.
    """

    def __init__(self, wanted: Iterable[str], signing: Signing | None = None) -> None:
        self._known = definitions()
        dtypes = {name: dtype_of(name) for name in sorted(wanted)}
        self._chain = Chain(self._known)
        self._filter = StampFilter()
        self._tally = Tally(self._known, signing)
        self._kinds = {self._known.names[n]: (n, dtype) for n, dtype in dtypes.items()}
        self._tail = b""
        self._decided = 0
        self._held = b""
        self._held_frames = _NO_FRAMES
        self._held_order = np.empty(0, np.int64)

    @property
    def link(self) -> LinkStats:
        """The counts of all that has been decided so far."""
        decided = self._decided - len(self._held)
        chain = self._chain
        return self._tally.stats(decided, chain.passed_bytes, chain.bad_crc, chain.unknown)

    def feed(self, data: bytes) -> FrameBlock | None:
        """Return the wanted messages that ``data`` completes, or None if there are none."""
        if len(data) >= _LARGE:
            _keep_freed_memory()
        return self._decode(data, final=False)

    def finish(self) -> FrameBlock | None:
        """Return the messages decided by the end of the stream; nothing may be fed after it."""
        return self._decode(b"", final=True)

    def _decode(self, data: bytes, *, final: bool) -> FrameBlock | None:
        held = len(self._held)
        start = STAMP_SIZE + held
        room = bytes(SLACK)
        joined = b"".join((room[:STAMP_SIZE], self._held, self._tail, data, room))
        stop = len(joined) - SLACK
        buffer = np.frombuffer(joined, np.uint8)
        found, open_from = find_frames(buffer, start, stop, self._known)
        stretch = Stretch(joined, start, stop, found, open_from, final=final)
        rows, decided = self._chain.walk(stretch)
        records = found.select(rows)
        order = records.begin + (self._decided - STAMP_SIZE - start)
        self._tail = joined[decided:stop]
        self._decided += decided - start
        if held:
            records = Frames.joined([self._held_frames, records])
            order = np.concatenate((self._held_order, order))
        return self._believe(joined, buffer, records, order, final=final)

    def _believe(
        self, joined: bytes, buffer: Bytes, records: Frames, order: Ints, *, final: bool
    ) -> FrameBlock | None:
        """Count and return the records whose stamps fit; keep back those that are pending."""
        stamps = stamps_of(buffer, records.begin)
        rows, pending = self._filter.sort(stamps, len(self._held_order))
        is_alone = len(pending) == 1 and self._filter.last_us is None
        if final and is_alone and not self._chain.unstamped:
            rows, pending = pending, pending[:0]
        self._hold(joined, records.select(pending), order[pending])
        if final:
            self._hold(joined, _NO_FRAMES, order[:0])
        believed = records.select(rows)
        if not len(believed):
            return None
        return self._columns(joined, buffer, believed, order[rows], stamps[rows])

    def _hold(self, joined: bytes, records: Frames, order: Ints) -> None:
        first = records.begin - STAMP_SIZE
        self._held = b"".join(joined[a:b] for a, b in zip(first, records.end, strict=True))
        sizes = records.end - first
        moves = STAMP_SIZE + np.cumsum(sizes) - sizes - first
        places = (records.begin, records.end, records.payload)
        begin, end, payload = (each + moves for each in places)
        self._held_frames = Frames(begin, end, payload, records.length, records.row)
        self._held_order = order

    def _columns(
        self, joined: bytes, buffer: Bytes, frames: Frames, order: Ints, stamps: Ints
    ) -> FrameBlock | None:
        header = frames.begin + _SEQUENCE_AT[frames.payload - frames.begin]
        sysid, compid = buffer[header + 1], buffer[header + 2]
        sender = sysid.astype(np.int64) * 256 + compid
        records = Records(frames, stamps, buffer[header], sysid, compid, sender)
        used = np.flatnonzero(self._tally.add(joined, buffer, records))
        if len(used) < len(order):
            records, order = records.select(used), order[used]
        frames = records.frames
        messages = {}
        counts = np.bincount(frames.row, minlength=len(self._known.names))
        for row, (name, dtype) in self._kinds.items():
            if counts[row]:
                rows = np.flatnonzero(frames.row == row)
                fields = _payloads(buffer, frames.payload[rows], frames.length[rows], dtype)
                of_sender = records.sysid[rows], records.compid[rows]
                columns = order[rows], records.stamps[rows], *of_sender, fields
                messages[name] = MessageBlock(name, *columns)
        return FrameBlock(messages) if messages else None


@cache
def _keep_freed_memory() -> None:
    """Free a large block once: from then on glibc keeps memory that NumPy frees, for the next use.

    This is for logs, which are read a megabyte at a time; a session that listens for days does
    better without it.
    """
    np.empty(1 << 24, np.uint8)


def _payloads(data: Bytes, at: Ints, length: Ints, dtype: np.dtype[Any]) -> Array:
    """Return the payloads (n,) of one message; bytes that were not sent are zero.

    ``at`` (n,) and ``length`` (n,) are the positions and the sizes as sent.
    """
    size = dtype.itemsize
    row_at = np.ndarray((len(data) - size + 1,), f"V{size}", data, 0, (1,))
    rows = row_at[at]
    if (length < size).any():
        sent = np.arange(size) < np.arange(size + 1)[:, None]
        masks = np.where(sent, np.uint8(0xFF), np.uint8(0))
        rows.view(np.uint8).reshape(-1, size)[:] &= masks[np.minimum(length, size)]
    return rows.view(dtype)
