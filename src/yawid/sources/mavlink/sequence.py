"""One sender of a link: how many of its frames came, were lost, or came twice."""

from dataclasses import dataclass

import numpy as np

from yawid.blocks import Bools, Bytes, Columns, Ints
from yawid.sources.mavlink.framing import Frames

_CYCLE = 256
_LONGEST = 128  # a larger step of the sequence is a restart, unless the time it took fits a loss
_FITS = 2.0  # it fits if it is that of the lost frames within this factor
_MOST_JUMPS = 1000  # further ones count as restarts
_LATE = 32  # a step back by up to this much is a frame that came late, by more a restart
_TWICE_WITHIN_US = 2_000_000  # the longest time between a frame and its duplicate
_WORD = 8


@dataclass(frozen=True, slots=True)
class Records(Columns):
    """Records in an array of bytes, one row each; ``sender`` (n,) is 256 * sysid + compid."""

    frames: Frames
    stamps: Ints
    sequence: Bytes
    sysid: Bytes
    compid: Bytes
    sender: Ints


class SenderCount:
    """The counts of the frames of one sender, as they are received.

    If two links carry the same vehicle, each frame comes twice. A frame is a duplicate if the last
    one of its sequence number was the same to the byte, not a whole turn of the sequence away, and
    within 2 s. The frame that came first counts. ``lost`` has the frames that steps of up to 128
    left out, :meth:`lost_in_jumps` those of larger ones. MAVProxy writes the link's number into the
    two low bits of the stamp; they are left as they are, so that a stamp may be 3 us off.
    """

    def __init__(self) -> None:
        self.frames = 0
        self.lost = 0
        self.duplicates = 0
        self.rejected = 0
        self._last_kept: int | None = None
        self._last_kept_us = 0
        self._steady_us = self._steady_frames = 0  # of all steps up to 128
        self._jumps: list[tuple[int, int]] = []  # larger ones: frames left out, time in us
        self._last: int | None = None
        self._place = 0  # the last frame's sequence number, counted on past 255
        self._highest = -1
        self._recent: list[tuple[int, int, bytes] | None] = [None] * _CYCLE

    def add(self, data: bytes, own: Records) -> Bools | None:
        """Count the frames, n >= 1; return which are no duplicates (n,), None if all are new."""
        steps = _steps(own.sequence, self._last)
        place = self._place + np.cumsum(steps.view(np.int8), dtype=np.int64)
        goes_on = bool(place[0] > self._highest and (steps[1:].view(np.int8) > 0).all())
        is_new = None
        self.frames += len(steps)
        if goes_on:
            self._count_lost(own.sequence, own.stamps, None)
        else:
            is_taken, is_twice = self._compare(data, own, place)
            is_new = ~is_twice
            self.duplicates += int(is_twice.sum())
            self._count_lost(own.sequence[is_new], own.stamps[is_new], is_taken[is_new])
        self._remember(data, own, place, goes_on=goes_on)
        return None if is_new is None or is_new.all() else is_new

    def lost_in_jumps(self) -> int:
        """Return how many frames were left out by steps of more than 128 whose time fits a loss.

        A frame takes as long as in the mean over all smaller steps.
        """
        if self._steady_us <= 0:
            return 0
        per_us = self._steady_frames / self._steady_us
        return sum(n for n, us in self._jumps if n / _FITS <= us * per_us <= n * _FITS)

    def _jump(self, missing: int, took_us: int) -> None:
        if len(self._jumps) < _MOST_JUMPS:
            self._jumps.append((missing, took_us))

    def _count_lost(self, sequence: Bytes, stamps: Ints, is_taken: Bools | None) -> None:
        """Count the frames that the steps of the sequence leave out.

        A frame that comes late was counted as missing before. A frame whose place ``is_taken``
        already is not late: the sender has started again.
        """
        if not len(sequence):
            return
        steps = _steps(sequence, self._last_kept).astype(np.int64)
        before_us = stamps[0] if self._last_kept is None else self._last_kept_us
        took_us = np.diff(stamps, prepend=before_us)
        is_small = (steps > 0) & (steps <= _LONGEST)
        self.lost += int((steps[is_small] - 1).sum())
        self._steady_frames += int(steps[is_small].sum())
        self._steady_us += int(took_us[is_small].sum())
        for row in np.flatnonzero((steps > _LONGEST) & (steps < _CYCLE - _LATE)).tolist():
            self._jump(int(steps[row]) - 1, int(took_us[row]))
        if is_taken is not None:
            back = _CYCLE - steps[~is_taken]
            self.lost -= int((back[back <= _LATE] + 1).sum())
        self._last_kept, self._last_kept_us = int(sequence[-1]), int(stamps[-1])

    def _compare(self, data: bytes, own: Records, place: Ints) -> tuple[Bools, Bools]:
        """Return which frames (n,) have the place of an earlier one, and which equal that one."""
        by_number = np.argsort(own.sequence, kind="stable")
        follows = np.diff(own.sequence[by_number]) == 0
        earlier, later = by_number[:-1][follows], by_number[1:][follows]
        is_taken = np.zeros(len(place), np.bool_)
        is_taken[later] = place[earlier] == place[later]
        near = is_taken[later]
        near &= np.abs(own.stamps[earlier] - own.stamps[later]) <= _TWICE_WITHIN_US
        earlier, later = earlier[near], later[near]
        is_twice = np.zeros(len(place), np.bool_)
        is_twice[later] = _same_bytes(data, own.frames, earlier, later)
        firsts = by_number[np.flatnonzero(np.concatenate(([True], ~follows)))]
        for row in firsts.tolist():
            recent = self._recent[own.sequence[row]]
            if recent is not None and recent[0] == place[row]:
                is_near = abs(int(own.stamps[row]) - recent[1]) <= _TWICE_WITHIN_US
                frame = data[own.frames.begin[row] : own.frames.end[row]]
                is_taken[row] = True
                is_twice[row] = is_near and recent[2] == frame
        return is_taken, is_twice

    def _remember(self, data: bytes, own: Records, place: Ints, *, goes_on: bool) -> None:
        rows = _last_rows(own.sequence)
        begin, end = own.frames.begin[rows].tolist(), own.frames.end[rows].tolist()
        when = place[rows].tolist(), own.stamps[rows].tolist()
        numbers = own.sequence[rows].tolist()
        for number, at, stamp, first, stop in zip(numbers, *when, begin, end, strict=True):
            self._recent[number] = at, stamp, data[first:stop]
        self._last, self._place = int(own.sequence[-1]), int(place[-1])
        # Only frames kept count: after a restart, lower places must not be suspect for good.
        kept = (entry[0] for entry in self._recent if entry is not None)
        self._highest = self._place if goes_on else max(kept)


def _steps(sequence: Bytes, before: int | None) -> Bytes:
    """Return the steps of the sequence modulo 256 (n,); that of the very first frame is 1."""
    steps = np.empty(len(sequence), np.uint8)
    steps[0] = 1 if before is None else (int(sequence[0]) - before) % _CYCLE
    np.subtract(sequence[1:], sequence[:-1], out=steps[1:])
    return steps


def _last_rows(sequence: Bytes) -> Ints:
    """Return the last row of each sequence number that occurs."""
    if len(sequence) == 1:
        return np.zeros(1, np.int64)
    last_row = np.full(_CYCLE, -1)
    first = max(len(sequence) - 4 * _CYCLE, 0)
    last_row[sequence[first:]] = np.arange(first, len(sequence))
    if first and (last_row < 0).any():
        last_row[sequence] = np.arange(len(sequence))
    return last_row[last_row >= 0]


def _same_bytes(data: bytes, frames: Frames, earlier: Ints, later: Ints) -> Bools:
    """Return whether the frames of two lists of rows are the same, byte for byte (n,)."""
    size = (frames.end - frames.begin)[earlier]
    same: Bools = size == (frames.end - frames.begin)[later]
    word_at = np.ndarray((len(data) - _WORD + 1,), np.uint64, data, 0, (1,))
    rows = np.flatnonzero(same)
    offset = 0
    while len(rows):
        # The last word ends with the frame: no frame is shorter than a word.
        at = np.minimum(offset, size[rows] - _WORD)
        first = word_at[frames.begin[earlier[rows]] + at]
        second = word_at[frames.begin[later[rows]] + at]
        same[rows] &= first == second
        offset += _WORD
        rows = rows[size[rows] > offset]
    return same
