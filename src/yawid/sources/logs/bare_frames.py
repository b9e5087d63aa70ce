"""Logs without stamps (.rlog, .raw): bare frames become the records of a tlog.

The times at which these frames were received are not recorded. Their stamps are made up: they
follow the vehicle's own clock, count from the first ATTITUDE received as if that were 1970, and
never fall. Gaps and reboots are visible in the vehicle's clock as always; only the time of day and
the latency are lost.
"""

from typing import NamedTuple

import numpy as np

from yawid.blocks import Bytes, Ints
from yawid.sources.mavlink.definitions import definitions
from yawid.sources.mavlink.framing import (
    LONGEST_HEADER,
    SLACK,
    STAMP_SIZE,
    Frames,
    find_frames,
    read_header,
)

_LONGEST_STEP_MS = 3_600_000  # a longer step of the clock is no time that has passed
_CLOCKS = ("ATTITUDE", "ATTITUDE_QUATERNION")  # both begin with time_boot_ms
_CLOCK_SIZE = 4


class Stamper:
    """The way from bare frames to the bytes of a tlog; where the bytes are cut changes nothing.

    A stamp is put before every intact frame, and before every damaged or unknown one that the next
    intact frame follows directly. All other bytes stay as they are, so that the decoder counts them
    as in a tlog. After damage, the next frame whose CRC fits counts as a frame: without stamps
    nothing else identifies it.
    """

    def __init__(self) -> None:
        self._known = definitions()
        self._clock = _Clock([self._known.names[name] for name in _CLOCKS])
        self._tail = b""
        self._in_step = True

    def feed(self, data: bytes) -> bytes:
        """Return the records that ``data`` completes."""
        return self._stamped(data, final=False)

    def finish(self) -> bytes:
        """Return the records that are decided by the end of the stream."""
        return self._stamped(b"", final=True)

    def _stamped(self, data: bytes, *, final: bool) -> bytes:
        room = bytes(SLACK)
        joined = b"".join((room, self._tail, data, room))
        stop = len(joined) - SLACK
        buffer = np.frombuffer(joined, np.uint8)
        found, open_from = find_frames(buffer, SLACK, stop, self._known)
        window = _Window(joined, found, stop if final else open_from, stop, final=final)
        places, decided = self._walk(window)
        stamps = self._clock.stamps(buffer, found, places)
        self._tail = joined[decided:stop]
        return _with_stamps(buffer[SLACK:decided], places - SLACK, stamps)

    def _walk(self, window: "_Window") -> tuple[Ints, int]:
        """Return where the frames to be stamped begin, and where the undecided bytes begin."""
        begin, end = window.found.begin, window.found.end
        run_ends = [*(np.flatnonzero(begin[1:] != end[:-1]) + 1).tolist(), len(begin)]
        places: list[Ints] = [np.empty(0, np.int64)]
        at, run = SLACK, 0
        while True:
            row = int(np.searchsorted(begin, at))
            is_frame = row < len(begin)
            if is_frame and begin[row] == at and (self._in_step or at < window.open_from):
                while run_ends[run] <= row:
                    run += 1
                places.append(begin[row : run_ends[run]])
                at, self._in_step = int(end[run_ends[run] - 1]), True
                continue
            after = self._end_of_damaged(window, at) if self._in_step else None
            if after is not None:
                if after < 0:
                    return np.concatenate(places), at
                places.append(np.array([at]))
                at = after
                continue
            self._in_step = False
            if not is_frame or begin[row] >= window.open_from:
                return np.concatenate(places), max(at, window.open_from)
            at = int(begin[row])

    def _end_of_damaged(self, window: "_Window", at: int) -> int | None:
        """Return where the damaged frame at ``at`` ends, if an intact one follows it directly.

        None if there is no such frame, -1 if the bytes that decide it have not come.
        """
        if at + LONGEST_HEADER > window.stop:
            return None if window.final else -1
        header = read_header(window.data, at, self._known)
        if header is None or not header.may_be:
            return None
        after = at + header.size
        row = int(np.searchsorted(window.found.begin, after))
        if row < len(window.found) and window.found.begin[row] == after:
            return after
        return -1 if after >= window.open_from and not window.final else None


class _Window(NamedTuple):
    """The bytes not decided yet, up to ``stop``, and the intact frames ``found`` in them.

    ``open_from`` is that of :func:`find_frames`. With ``final`` no more bytes will come.
    """

    data: bytes
    found: Frames
    open_from: int
    stop: int
    final: bool = False


class _Clock:
    """The stamps by the clock of one sender: the first one whose attitude is received."""

    def __init__(self, rows: list[int]) -> None:
        self._rows = rows
        self._source: tuple[int, int, int] | None = None
        self._boot_ms = 0
        self._stamp_us = 0

    def stamps(self, data: Bytes, found: Frames, places: Ints) -> Ints:
        """Return the stamps (n,) in us of the frames that begin at ``places`` (n,)."""
        is_clock = np.isin(found.row, self._rows) & np.isin(found.begin, places)
        begins, stamps = [0], [self._stamp_us]
        for row in np.flatnonzero(is_clock).tolist():
            payload = int(found.payload[row])
            # The ids are right before the message id: at -3 in MAVLink 1, at -5 in MAVLink 2.
            ids = payload - (3 if payload - found.begin[row] == 6 else 5)
            source = int(found.row[row]), int(data[ids]), int(data[ids + 1])
            if self._source in (None, source):
                # MAVLink 2 does not send zeros at the end of a payload.
                size = min(_CLOCK_SIZE, int(found.length[row]))
                boot_ms = int.from_bytes(data[payload : payload + size].tobytes(), "little")
                self._advance(source, boot_ms)
                begins.append(int(found.begin[row]))
                stamps.append(self._stamp_us)
        last = np.searchsorted(np.array(begins), places, side="right") - 1
        return np.array(stamps, np.int64)[last]

    def _advance(self, source: tuple[int, int, int], boot_ms: int) -> None:
        if self._source is None:
            self._source = source
        elif 0 < boot_ms - self._boot_ms <= _LONGEST_STEP_MS:
            self._stamp_us += 1000 * (boot_ms - self._boot_ms)
        self._boot_ms = boot_ms


def _with_stamps(data: Bytes, places: Ints, stamps: Ints) -> bytes:
    """Return ``data`` with a stamp inserted at each of the places (n,)."""
    joined = np.empty(len(data) + STAMP_SIZE * len(places), np.uint8)
    slots = places + STAMP_SIZE * np.arange(len(places))
    slots = slots[:, None] + np.arange(STAMP_SIZE)
    is_data = np.ones(len(joined), np.bool_)
    is_data[slots] = False
    joined[is_data] = data
    joined[slots] = stamps.astype(">i8")[:, None].view(np.uint8)
    return joined.tobytes()
