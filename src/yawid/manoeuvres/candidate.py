"""What may become a manoeuvre: how long it goes on, and how it stands."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from yawid.blocks import Floats, SampleBlock
from yawid.channels.sample_flags import AIRSPEED_SHARE, LEAST_TRAVEL, WINDOW_S
from yawid.results.excitation import LEAST_STROKE

LONGEST_S = 120.0
MOVES = 2.0 * LEAST_TRAVEL
"""A rudder that covers more than this of half its travel within 5 s has left where it stood."""


class Progress(NamedTuple):
    """How a manoeuvre stands that may be on its way; it changes nothing of what is found.

    ``stroke`` is how far the rudder's own part moved within the newest 5 s, in parts of half its
    travel, None where too little is known of how it follows the aileron; ``rests_s`` how long it
    has rested. Of the manoeuvre being recorded, if there is one: its first second since boot, how
    long it is, and whether it has moved far enough to be answered.
    """

    stroke: float | None = None
    rests_s: float = 0.0
    from_s: float | None = None
    lasted_s: float = 0.0
    is_excited: bool = False

    @classmethod
    def of(cls, kept: Sequence[SampleBlock], *, is_excited: bool) -> "Progress":
        """Return how what is recorded stands, by the blocks kept of it, at least one."""
        first_us, last_us = kept[0].boot_us[0], kept[-1].boot_us[-1]
        lasted_s = (last_us - first_us) / 1e6
        return cls(from_s=first_us / 1e6, lasted_s=lasted_s, is_excited=is_excited)


class Candidate:
    """What may become a manoeuvre: it begins with ``before``, the second before it moved."""

    def __init__(self, sample_time_s: float, before: SampleBlock | None, began_k: int) -> None:
        self.is_excited = False
        self.began_k = began_k
        self._kept = [] if before is None else [before]
        self._longest = round(LONGEST_S / sample_time_s)
        self._window = max(2, round(WINDOW_S / sample_time_s))
        self._speeds = np.empty(0) if before is None else before.airspeed

    def feed(self, rows: SampleBlock, stroke: Floats) -> tuple[int, bool]:
        """Take rows up to where it ends; return how many belong to it and whether it has ended."""
        first_k = self._kept[0].k[0] if self._kept else rows.k[0]
        resting = np.flatnonzero(stroke <= MOVES)
        stop = int(resting[0]) + 1 if len(resting) else len(rows)
        ends = [stop, *self._other_airspeed(rows)]
        ends.append(int(np.searchsorted(rows.k, first_k + self._longest)))
        count = min(ends)
        is_over = count < len(rows) or bool(len(resting) and count == stop)
        if count:
            self._kept.append(rows.select(slice(0, count)))
            self._speeds = np.concatenate([self._speeds, rows.airspeed[:count]])
            self.is_excited |= bool((stroke[:count] >= LEAST_STROKE).any())
        return count, is_over

    def flown_in(self, mode: float) -> None:
        """Say in which mode it was flown, as is known now."""
        self._kept = [flown_in(mode, rows) for rows in self._kept]

    def _other_airspeed(self, rows: SampleBlock) -> list[int]:
        """Return the first row at which the newest 5 s differ by 10 % from all of it until then."""
        speeds = np.concatenate([self._speeds, rows.airspeed])
        known = np.isfinite(speeds)
        total, count = np.cumsum(np.where(known, speeds, 0.0)), np.cumsum(known)
        before = np.arange(len(speeds)) - self._window
        old = np.where(before >= 0, before, 0)
        newest_total = total - np.where(before >= 0, total[old], 0.0)
        newest_count = count - np.where(before >= 0, count[old], 0)
        sound = (newest_count > 0) & (before >= 0)
        mean, newest = total / np.maximum(count, 1), newest_total / np.maximum(newest_count, 1)
        other = sound & (np.abs(newest - mean) > AIRSPEED_SHARE * mean)
        rest = np.flatnonzero(other[len(self._speeds) :])
        return [int(rest[0])] if len(rest) else []

    def progress(self) -> Progress:
        """Return how it stands."""
        return Progress.of(self._kept, is_excited=self.is_excited)

    def samples(self) -> SampleBlock:
        """Return all of it."""
        return SampleBlock.joined(self._kept)


def flown_in(mode: float, rows: SampleBlock) -> SampleBlock:
    """Return the rows as flown in this mode."""
    return replace(rows, mode=np.full(len(rows), mode))
