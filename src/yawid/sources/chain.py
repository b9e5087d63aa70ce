"""Decide which intact frames are records of the stream, and which only look like one.

The stream is walked from front to back; what is decided depends on the bytes alone, never on how they were
cut. A position is *in step* when the record before it has just ended there.

1. In step, an intact frame behind its stamp is a record.
2. In step, a frame that is not intact (wrong CRC, unknown id) is passed over whole if a record header
   follows it whose stamp agrees with its own, so that nothing inside its payload is believed. If an intact
   frame ends at that very place, the length is what was damaged, and 3 applies.
3. Otherwise the next intact frame is looked for byte by byte.

A frame inside an intact one is never looked at. A frame whose stamp would reach into the frame before has
none: it hides what is inside it and is no record.
"""

from __future__ import annotations

from enum import Enum

import numpy as np
from numpy.typing import NDArray

from yawid.blocks import Bytes, Ints
from yawid.sources.framing import (
    LONGEST_HEADER,
    MAGIC_V1,
    MAGIC_V2,
    STAMP_SIZE,
    Frames,
    read_header,
)
from yawid.sources.messages import UNKNOWN, Definitions

STAMP_TOLERANCE_US = 3 * 86400 * 1_000_000


def stamps_agree(a: int, b: int) -> bool:
    """Return whether two stamps may stand side by side: both in range and within 3 days."""
    return a >= 0 and b >= 0 and abs(a - b) <= STAMP_TOLERANCE_US


def stamps_of(data: Bytes, begin: Ints) -> Ints:
    """Return the stamps (n,) in microseconds in front of the frames; out of range is negative."""
    stamp_at = np.ndarray((len(data) - STAMP_SIZE + 1,), ">i8", data, 0, (1,))
    return stamp_at[begin - STAMP_SIZE].astype(np.int64)


class _Pass(Enum):
    """What is to be done with a record that is not intact."""

    WAIT = 0  # the bytes that decide have not come yet
    SEARCH = 1


class Chain:
    """The walk along one stream. ``bad_crc`` and ``unknown`` count the records passed over whole."""

    def __init__(self, known: Definitions) -> None:
        self.bad_crc = 0
        self.unknown = 0
        self.passed_bytes = 0
        self._known = known
        self._in_step = True
        self._last_stamp = -1

    def walk(
        self, data: Bytes, start: int, stop: int, frames: Frames, open_from: int, *, final: bool
    ) -> tuple[Ints | slice, int]:
        """Return the rows of ``frames`` that are records, and the position up to which all is decided.

        ``data[start:stop]`` are the bytes not yet decided and ``open_from`` is that of
        :func:`find_frames`. With ``final`` no more bytes will come and everything is decided.
        """
        begin, end = frames.begin, frames.end
        if final:
            open_from = stop
        run_ends = np.append(np.flatnonzero(begin[1:] != end[:-1] + STAMP_SIZE), len(begin) - 1)
        runs: list[tuple[int, int]] = []
        at = start
        while True:
            row = int(np.searchsorted(begin, at + STAMP_SIZE))
            is_here = row < len(begin) and begin[row] == at + STAMP_SIZE
            if is_here and (self._in_step or begin[row] < open_from):
                last = int(run_ends[np.searchsorted(run_ends, row)])
                runs.append((row, last + 1))
                at, self._in_step = int(end[last]), True
                self._last_stamp = int(stamps_of(data, begin[last : last + 1])[0])
                continue
            if self._in_step:
                after = self._pass_over(data, at, stop, frames, final=final)
                if after is _Pass.WAIT:
                    return _rows(runs, len(begin)), at
                if isinstance(after, int):
                    at = after
                    continue
                self._in_step = False
            row = int(np.searchsorted(begin, at))
            if row == len(begin) or begin[row] >= open_from:
                break
            has_stamp = begin[row] >= at + STAMP_SIZE
            at = int(begin[row] - STAMP_SIZE if has_stamp else end[row])
            self._in_step = not has_stamp
        decided = stop if final else max(at, open_from - STAMP_SIZE)
        return _rows(runs, len(begin)), decided

    def _pass_over(
        self, data: Bytes, at: int, stop: int, frames: Frames, *, final: bool
    ) -> int | _Pass:
        """Return where the record at ``at``, in step and not intact, ends; or what else to do."""
        begin = at + STAMP_SIZE
        if begin + LONGEST_HEADER > stop:
            return _Pass.SEARCH if final else _Pass.WAIT
        header = read_header(data, begin, self._known)
        if header is None:
            return _Pass.SEARCH
        after = begin + header.size
        at_the_end = final and after == stop
        if after + STAMP_SIZE >= stop and not at_the_end:
            return _Pass.SEARCH if final else _Pass.WAIT
        neighbour = self._last_stamp if at_the_end else _stamp(data, after)
        follows = at_the_end or data[after + STAMP_SIZE] in (MAGIC_V1, MAGIC_V2)
        if not follows or not stamps_agree(_stamp(data, at), neighbour):
            return _Pass.SEARCH
        inside = slice(*np.searchsorted(frames.begin, (begin + 1, after)))
        if (frames.end[inside] == after).any():
            return _Pass.SEARCH
        self.unknown += header.row == UNKNOWN
        self.bad_crc += header.row != UNKNOWN
        self.passed_bytes += after - at
        return after


def _stamp(data: Bytes, at: int) -> int:
    return int.from_bytes(data[at : at + STAMP_SIZE].tobytes(), "big", signed=True)


def _rows(runs: list[tuple[int, int]], count: int) -> Ints | slice:
    """Return the rows of all runs."""
    if runs == [(0, count)]:
        return slice(None)
    keep: NDArray[np.bool_] = np.zeros(count, np.bool_)
    for first, stop in runs:
        keep[first:stop] = True
    return np.flatnonzero(keep)
