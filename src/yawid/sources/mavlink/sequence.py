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
        # Of each number the last frame, its place and its stamp.
        self._frames, self._us = [b""] * _CYCLE, np.zeros(_CYCLE, np.int64)
        self._at = np.full(_CYCLE, np.iinfo(np.int64).min)

    def add(self, data: bytes, own: Records) -> Bools:
        """Count the frames, n >= 1; return which are no duplicates (n,)."""
        steps = _steps(own.sequence, self._last)
        place = self._place + np.cumsum(steps.view(np.int8), dtype=np.int64)
        self.frames += len(steps)
        self._last, self._place = int(own.sequence[-1]), int(place[-1])
        if place[0] > self._highest and (steps[1:].view(np.int8) > 0).all():  # each is a later one
            self._keep(data, own, place)
            self._highest = self._place
            self._count_lost(own.sequence, own.stamps, None)
            return np.ones(len(steps), np.bool_)
        is_taken, is_twice = self._compare(data, own, place)
        # Only frames kept count: after a restart, lower places must not be suspect for good.
        self._highest = int(self._at.max())
        is_new = ~is_twice
        self.duplicates += int(is_twice.sum())
        self._count_lost(own.sequence[is_new], own.stamps[is_new], is_taken[is_new])
        return is_new

    def lost_in_jumps(self) -> int:
        """Return how many frames were left out by steps of more than 128 whose time fits a loss.

        A frame takes as long as in the mean over all smaller steps.
        """
        if self._steady_us <= 0:
            return 0
        per_us = self._steady_frames / self._steady_us
        return sum(n for n, us in self._jumps if n / _FITS <= us * per_us <= n * _FITS)

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
        jumps = np.flatnonzero((steps > _LONGEST) & (steps < _CYCLE - _LATE))
        rows = jumps[: _MOST_JUMPS - len(self._jumps)]
        self._jumps += zip((steps[rows] - 1).tolist(), took_us[rows].tolist(), strict=True)
        if is_taken is not None:
            back = _CYCLE - steps[~is_taken]
            self.lost -= int((back[back <= _LATE] + 1).sum())
        self._last_kept, self._last_kept_us = int(sequence[-1]), int(stamps[-1])

    def _compare(self, data: bytes, own: Records, place: Ints) -> tuple[Bools, Bools]:
        """Return which frames (n,) have the place of the last one of their number, and equal it."""
        rows = np.argsort(own.sequence, kind="stable")
        number, before = own.sequence[rows], np.roll(rows, 1)
        firsts = np.flatnonzero(np.diff(number, prepend=~number[:1]))
        before[firsts] = len(rows) + number[firsts].astype(np.int64)  # those kept follow these
        at, us = np.append(place, self._at), np.append(own.stamps, self._us)
        is_taken, is_twice = np.zeros((2, len(place)), np.bool_)
        is_taken[rows] = at[before] == place[rows]
        near = is_taken[rows] & (np.abs(us[before] - own.stamps[rows]) <= _TWICE_WITHIN_US)
        if near.any():
            is_twice[rows[near]] = self._equal(data, own.frames, rows[near], before[near])
        self._keep(data, own, place)
        return is_taken, is_twice

    def _equal(self, data: bytes, frames: Frames, later: Ints, earlier: Ints) -> Bools:
        """Return which pairs of frames (m,) are equal, by their rows; those kept follow them."""
        both, kept = data + b"".join(self._frames), np.fromiter(map(len, self._frames), np.int64)
        size = np.append(frames.end - frames.begin, kept)
        begin = np.append(frames.begin, len(data) + np.cumsum(kept) - kept)
        same: Bools = size[later] == size[earlier]
        for length in np.flatnonzero(np.bincount(size[later[same]])).tolist():
            pairs = np.flatnonzero(same & (size[later] == length))
            frame_at = np.ndarray((len(both) - length + 1,), f"S{length}", both, 0, (1,))
            same[pairs] = frame_at[begin[later[pairs]]] == frame_at[begin[earlier[pairs]]]
        return same

    def _keep(self, data: bytes, own: Records, place: Ints) -> None:
        """Keep the last frame of each number."""
        last_row = np.full(_CYCLE, -1)
        last_row[own.sequence] = np.arange(len(place))
        numbers = np.flatnonzero(last_row >= 0)
        rows = last_row[numbers]
        self._at[numbers], self._us[numbers] = place[rows], own.stamps[rows]
        spans = numbers.tolist(), own.frames.begin[rows].tolist(), own.frames.end[rows].tolist()
        for number, first, stop in zip(*spans, strict=True):
            self._frames[number] = data[first:stop]


def _steps(sequence: Bytes, before: int | None) -> Bytes:
    """Return the steps of the sequence modulo 256 (n,); that of the very first frame is 1."""
    steps = np.empty(len(sequence), np.uint8)
    steps[0] = 1 if before is None else (int(sequence[0]) - before) % _CYCLE
    np.subtract(sequence[1:], sequence[:-1], out=steps[1:])
    return steps
