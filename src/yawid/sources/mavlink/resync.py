"""Resynchronisation: which intact frames are records of the stream, and which only look like one.

The stream is walked from front to back; decisions depend on the bytes alone, never on where they
were cut. A position is *in step* if a record ends exactly there.

1. In step, an intact frame after a stamp is a record.
2. In step, a frame that is not intact (wrong CRC, unknown id) is passed over as a whole if a record
   header follows it whose stamp agrees with its own, so that nothing inside its payload is
   believed; at the end of the stream, the stamp before it must agree. But if an intact frame ends
   at the same place, or is inside a frame that cannot be so long, the length was damaged and rule 3
   applies.
3. Otherwise the next intact frame is searched for byte by byte.

A frame inside an intact one is never considered. A frame whose stamp would overlap the frame before
it has no stamp: it hides what is inside it and is no record. A record is believed only if its stamp
fits: within 3 days of its neighbours (:class:`StampFilter`).
"""

from bisect import bisect_left, bisect_right
from collections import Counter
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from yawid.blocks import Bytes, Ints
from yawid.sources.mavlink.definitions import UNKNOWN, Definitions
from yawid.sources.mavlink.framing import (
    LONGEST_HEADER,
    MAGIC_V1,
    MAGIC_V2,
    STAMP_SIZE,
    Frames,
    read_header,
)

STAMP_TOLERANCE_US = 3 * 86400 * 1_000_000
NO_STAMP = -1
LATEST_US = 1 << 53  # the year 2255
_NOT_YET = -1
_MANY = 8  # with more gaps than this, plain lists are quicker than arrays
_MOST_PENDING = 8  # the most records that wait for another with a stamp like theirs


class Stretch:
    """The bytes not decided yet, ``data[start:stop]``, and the intact ``frames`` in them.

    ``open_from`` is that of :func:`find_frames`. With ``final`` no more bytes will come, and
    everything is to be decided.
    """

    def __init__(
        self, data: bytes, start: int, stop: int, frames: Frames, open_from: int, *, final: bool
    ) -> None:
        self.data = data
        self.start = start
        self.stop = stop
        self.final = final
        self.searched = stop if final else open_from - STAMP_SIZE
        self.begin: list[int] | Ints = frames.begin
        self.end: list[int] | Ints = frames.end
        follows = frames.begin[1:] == frames.end[:-1] + STAMP_SIZE
        self.run_ends: list[int] = [*(np.flatnonzero(~follows) + 1).tolist(), len(frames)]
        if len(self.run_ends) > _MANY:
            self.begin, self.end = frames.begin.tolist(), frames.end.tolist()

    def first_at(self, position: int) -> int:
        """Return the row of the first intact frame that begins at ``position`` or later."""
        return bisect_left(self.begin, position)

    def is_settled(self, row: int) -> bool:
        """Return whether there is such a row and nothing before it can still become intact."""
        return row < len(self.begin) and self.begin[row] < self.searched + STAMP_SIZE

    def run_end(self, row: int) -> int:
        """Return the row after the last of those records that follow ``row`` without a gap."""
        return self.run_ends[bisect_right(self.run_ends, row)]

    def stamp(self, at: int) -> int:
        """Return the stamp at a position, ``NO_STAMP`` if it is out of range."""
        stamp = int.from_bytes(self.data[at : at + STAMP_SIZE], "big")
        return stamp if stamp <= LATEST_US else NO_STAMP


def stamps_agree(a: int, b: int) -> bool:
    """Return whether two stamps may be neighbours: both in range and within 3 days."""
    return NO_STAMP not in (a, b) and abs(a - b) <= STAMP_TOLERANCE_US


def stamps_of(data: Bytes, begin: Ints) -> Ints:
    """Return the stamps (n,) in microseconds in front of frames, ``NO_STAMP`` if out of range."""
    stamp_at = np.ndarray((len(data) - STAMP_SIZE + 1,), ">i8", data, 0, (1,))
    stamps = stamp_at[begin - STAMP_SIZE].astype(np.int64)
    stamps[(stamps < 0) | (stamps > LATEST_US)] = NO_STAMP
    return stamps


class Chain:
    """The walk along one stream.

    ``bad_crc`` and ``unknown`` count the records passed over as a whole, by the sender in their
    headers (256 * sysid + compid); ``passed_bytes`` is their size. ``unstamped`` counts the intact
    frames that have no stamp. ``is_in_step`` says whether a record ends right before the next byte;
    ``last_us`` is its stamp.
    """

    def __init__(self, known: Definitions) -> None:
        self.bad_crc: Counter[int] = Counter()
        self.unknown: Counter[int] = Counter()
        self.passed_bytes = 0
        self.unstamped = 0
        self._known = known
        self.is_in_step = True
        self.last_us = NO_STAMP

    def walk(self, stretch: Stretch) -> tuple[Ints | slice, int]:
        """Return the rows (m,) of the frames that are records, and where open bytes begin."""
        begin, end = stretch.begin, stretch.end
        runs: list[tuple[int, int]] = []
        at = stretch.start
        while True:
            row = stretch.first_at(at + STAMP_SIZE)
            is_here = row < len(begin) and begin[row] == at + STAMP_SIZE
            if is_here and (self.is_in_step or stretch.is_settled(row)):
                after = stretch.run_end(row)
                runs.append((row, after))
                at, self.is_in_step = int(end[after - 1]), True
                self.last_us = stretch.stamp(int(begin[after - 1]) - STAMP_SIZE)
                continue
            if self.is_in_step:
                passed = self._pass_over(stretch, at)
                if passed == _NOT_YET:
                    return _rows(runs, len(begin)), at
                if passed is not None:
                    at = passed
                    continue
                self.is_in_step = False
            row = stretch.first_at(at)
            if not stretch.is_settled(row):
                return _rows(runs, len(begin)), max(at, stretch.searched)
            has_stamp = begin[row] >= at + STAMP_SIZE
            at = int(begin[row] - STAMP_SIZE if has_stamp else end[row])
            self.is_in_step = not has_stamp
            self.unstamped += not has_stamp

    def _pass_over(self, stretch: Stretch, at: int) -> int | None:
        """Return where the damaged or unknown record at ``at`` ends.

        None if there is no such record, ``_NOT_YET`` if the bytes that decide it have not come.
        """
        begin = at + STAMP_SIZE
        undecided = None if stretch.final else _NOT_YET
        if begin + LONGEST_HEADER > stretch.stop:
            return undecided
        header = read_header(stretch.data, begin, self._known)
        if header is None:
            return None
        after = begin + header.size
        at_the_end = stretch.final and after == stretch.stop
        if after + STAMP_SIZE >= stretch.stop and not at_the_end:
            return undecided
        neighbour = self.last_us if at_the_end else stretch.stamp(after)
        follows = at_the_end or stretch.data[after + STAMP_SIZE] in (MAGIC_V1, MAGIC_V2)
        if not follows or not stamps_agree(stretch.stamp(at), neighbour):
            return None
        inside = stretch.end[stretch.first_at(begin + 1) : stretch.first_at(after)]
        if after in inside or (len(inside) and not header.may_be):
            return None
        count = self.unknown if header.row == UNKNOWN else self.bad_crc
        count[header.sender] += 1
        self.passed_bytes += after - at
        return after


def _rows(runs: list[tuple[int, int]], count: int) -> Ints | slice:
    if runs == [(0, count)]:
        return slice(None)
    keep: NDArray[np.bool_] = np.zeros(count, np.bool_)
    for first, stop in runs:
        keep[first:stop] = True
    return np.flatnonzero(keep)


class StampFilter:
    """The decision which records have stamps that belong to the stream.

    A stamp belongs if it agrees with that of the last record believed. A record whose stamp does
    not stays pending. If a later record agrees with it, both are believed (the clock was set); if a
    later one agrees with the last record believed, it is dropped (the stamp was damaged). Nothing
    is lost if the very first stamp is the damaged one. ``last_us`` is the stamp of the last record
    believed, None before the first.
    """

    def __init__(self) -> None:
        self.last_us: int | None = None

    def sort(self, stamps: Ints, pending: int) -> tuple[Ints | slice, Ints]:
        """Return the rows to believe and the rows that stay pending, both rising.

        ``stamps`` (n,) are those of the records in the order received; the first ``pending`` of
        them were left pending by the last call.
        """
        fresh = stamps[pending:]
        near = np.abs(np.diff(fresh)) <= STAMP_TOLERANCE_US
        near &= (fresh[1:] != NO_STAMP) & (fresh[:-1] != NO_STAMP)
        edges = [0, *(np.flatnonzero(~near) + 1).tolist(), len(fresh)]
        if not pending and len(edges) == 2 and len(fresh) and self._continues(int(fresh[0])):
            self.last_us = int(fresh[-1])
            return slice(None), np.empty(0, np.int64)
        believed = np.zeros(len(stamps), np.bool_)
        waiting = list(range(pending))
        for first, stop in pairwise(edges):
            if first == stop:
                continue
            run = slice(pending + first, pending + stop)
            stamp = int(stamps[run.start])
            if not self._continues(stamp):
                partner = [i for i in waiting if stamps_agree(int(stamps[i]), stamp)]
                if not partner and stop - first == 1:
                    waiting = [*waiting, run.start][-_MOST_PENDING:]
                    continue
                believed[partner] = True
            believed[run] = True
            waiting = []
            self.last_us = int(stamps[run.stop - 1])
        return np.flatnonzero(believed), np.array(waiting, np.int64)

    def _continues(self, stamp: int) -> bool:
        return self.last_us is not None and stamps_agree(self.last_us, stamp)
