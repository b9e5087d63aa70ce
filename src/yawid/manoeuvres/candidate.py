"""A candidate for a manoeuvre: how long it lasts, and how it progresses."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from yawid.blocks import AIRSPEED_SHARE, LEAST_TRAVEL, WINDOW_S, Floats, SampleBlock, extremes
from yawid.results.excitation import LEAST_STROKE

LONGEST_S = 120.0
"""The longest manoeuvre in s."""
MOVES = 2.0 * LEAST_TRAVEL
"""A rudder that covers a greater part of half its travel within 5 s has left its rest position."""
DECAYED, DECAY_S = 0.1, 4.0
"""The yaw rate has decayed where it moves within so many s by no more than this part of its largest
movement in the manoeuvre within so many s."""
LONGEST_REST_S = 15.0
"""The longest rest of the rudder, in s, in which a manoeuvre waits for the yaw rate to decay."""
OTHER_SPEED = 1.3
"""The largest factor between first and last airspeed. Beyond it, as in a take-off or a landing, wn
changes with the airspeed, and the answer holds for neither of the two."""
SPEED_S = 2.0
"""The first and the last airspeed are means over this many seconds, since a gust is shorter."""


class UnderWay(NamedTuple):
    """The progress of a manoeuvre that may be under way, for display: it changes no result.

    ``stroke`` is how far the rudder's own part moved within the newest 5 s, as a part of half its
    travel, None where too little is known of how it follows the aileron; ``rests_s`` is how long it
    has rested. If a manoeuvre is being recorded, ``from_s`` is its beginning in s since boot,
    ``lasted_s`` its length so far, and ``is_excited`` whether the rudder moved far enough for an
    answer.
    """

    stroke: float | None = None
    rests_s: float = 0.0
    from_s: float | None = None
    lasted_s: float = 0.0
    is_excited: bool = False

    @classmethod
    def of(cls, kept: Sequence[SampleBlock], *, is_excited: bool) -> "UnderWay":
        """Return the progress of what is recorded, from the blocks ``kept`` of it, one at least."""
        first_us, last_us = kept[0].boot_us[0], kept[-1].boot_us[-1]
        lasted_s = (last_us - first_us) / 1e6
        return cls(from_s=first_us / 1e6, lasted_s=lasted_s, is_excited=is_excited)


class Candidate:
    """Samples that may become a manoeuvre; they begin with ``before``, the second before it moved.

    ``began_k`` is the grid number of the first row at which the rudder moves.
    """

    def __init__(self, sample_time_s: float, before: SampleBlock | None, began_k: int) -> None:
        self.is_excited = False
        self.began_k = began_k
        self._kept = [] if before is None else [before]
        self._longest = round(LONGEST_S / sample_time_s)
        self._window = max(2, round(WINDOW_S / sample_time_s))
        self._wait = round((LONGEST_REST_S - WINDOW_S) / sample_time_s)
        self._decay = max(2, round(DECAY_S / sample_time_s))
        self._few = speed_rows(sample_time_s)
        self._speeds = np.empty(0) if before is None else before.airspeed
        self._yaw = np.empty((0, 2)) if before is None else _yaw_rates(before)
        self._swung = np.zeros(2)
        self._rests_from_k: int | None = None

    @property
    def rings(self) -> bool:
        """Whether the rudder has rested for 5 s, and the manoeuvre waits for the yaw rate."""
        return self._rests_from_k is not None

    def feed(self, rows: SampleBlock, stroke: Floats) -> tuple[int, bool]:
        """Take in rows up to its end; return how many belong to it, and whether it has ended."""
        first_k = self._kept[0].k[0] if self._kept else rows.k[0]
        stop, rests_from_k = self._rest_end(rows, stroke)
        ends = [len(rows) if stop is None else stop, *self._other_airspeed(rows)]
        ends.append(int(np.searchsorted(rows.k, first_k + self._longest)))
        count = min(ends)
        is_over = count < len(rows) or stop == count
        self._rests_from_k = rests_from_k
        if count:
            self._kept.append(rows.select(slice(0, count)))
            self._speeds = np.concatenate([self._speeds, rows.airspeed[:count]])
            self.is_excited |= bool((stroke[:count] >= LEAST_STROKE).any())
        return count, is_over

    def _rest_end(self, rows: SampleBlock, stroke: Floats) -> tuple[int | None, int | None]:
        """Return how many rows are left until its rest ends it, and the k at which that rest began.

        The rest ends it where the yaw rate has decayed, where it lasts for 15 s, and where the
        rudder moves again. One that never moved far enough does not wait. Both are None if unknown.
        """
        rates = np.concatenate([self._yaw, _yaw_rates(rows)])
        swings = np.column_stack([moved_within(x, self._decay) for x in rates.T])[-len(rows) :]
        most = np.maximum(np.maximum.accumulate(swings), self._swung)
        self._yaw, self._swung = rates[-self._decay :], most[-1]
        rests = stroke <= MOVES
        excited = self.is_excited | np.logical_or.accumulate(stroke >= LEAST_STROKE)
        since = self._rests_from_k
        if since is None:
            if not rests.any():
                return None, None
            since = int(rows.k[np.argmax(rests)])
        waited = rows.k >= since
        over = ~excited | (swings <= DECAYED * most).any(axis=1) | (rows.k >= since + self._wait)
        ends = np.flatnonzero(waited & rests & over)
        again = np.flatnonzero(waited & ~rests)
        last = [int(ends[0]) + 1] if len(ends) else []
        last += [int(again[0])] if len(again) else []
        return (min(last) if last else None), since

    def given_back(self, count: int) -> SampleBlock | None:
        """Give back the newest rows of the wait for the decay: the next manoeuvre begins with them.

        They span ``count`` samples at most, and none of the 5 s of rest that it keeps.
        """
        rows = self.samples()
        assert self._rests_from_k is not None
        first_k = max(int(rows.k[-1]) + 1 - count, self._rests_from_k + 1)
        at = int(np.searchsorted(rows.k, first_k))
        self._kept = [rows.select(slice(0, at))]
        return rows.select(slice(at, None)) if at < len(rows) else None

    def flown_in(self, mode: float) -> None:
        """Set the flight mode of all its rows, which has only now become known."""
        self._kept = [flown_in(mode, rows) for rows in self._kept]

    def _other_airspeed(self, rows: SampleBlock) -> list[int]:
        """Return the first row at which the airspeed has changed, as a list of one row or none.

        There the mean of the newest 5 s differs by more than 10 % from the mean of all until then,
        or the mean of the newest 2 s by more than a factor of 1.3 from that of the first 2 s.
        """
        speeds = np.concatenate([self._speeds, rows.airspeed])
        before = np.arange(len(speeds)) - self._window
        mean, newest = _running_mean(speeds, len(speeds)), _running_mean(speeds, self._window)
        other = (before >= 0) & (np.abs(newest - mean) > AIRSPEED_SHARE * mean)
        other |= speed_factors(speeds, self._few) > OTHER_SPEED
        rest = np.flatnonzero(other[len(self._speeds) :])
        return [int(rest[0])] if len(rest) else []

    def progress(self) -> UnderWay:
        """Return its progress."""
        return UnderWay.of(self._kept, is_excited=self.is_excited)

    def samples(self) -> SampleBlock:
        """Return all its samples as one block."""
        return SampleBlock.joined(self._kept)


def speed_rows(sample_time_s: float) -> int:
    """Return the number of rows over which the first and the last airspeed are averaged."""
    return max(1, round(SPEED_S / sample_time_s))


def speed_factors(speeds: Floats, rows: int) -> Floats:
    """Return the factors (n,), 1 or more, by which speeds (n,) differ from the first speed.

    Each speed, the first one too, is the mean over the newest ``rows``. A factor is NaN where the
    speed is unknown, and before the first mean is complete.
    """
    newest = _running_mean(np.where(speeds > 0.0, speeds, np.nan), rows)
    later = np.cumsum(np.isfinite(newest)) >= rows
    if not later.any():
        return np.full(len(speeds), np.nan)
    first = newest[int(np.argmax(later))]
    return np.where(later, np.maximum(newest / first, first / newest), np.nan)


def moved_within(x: Floats, window: int) -> Floats:
    """Return how far x (n,) moved within the last ``window`` rows, by its known values."""
    known, before = np.isfinite(x), np.full(window - 1, np.inf)
    high = extremes(np.maximum, np.concatenate([-before, np.where(known, x, -np.inf)]), window)
    low = extremes(np.minimum, np.concatenate([before, np.where(known, x, np.inf)]), window)
    return np.asarray(np.maximum(high - low, 0.0), np.float64)


def _yaw_rates(rows: SampleBlock) -> Floats:
    """Return the yaw rate as it is, and without the turn that bank and airspeed imply, (n, 2)."""
    return np.column_stack([rows.y, rows.y - np.nan_to_num(rows.turn_rate)])


def _running_mean(x: Floats, window: int) -> Floats:
    """Return the mean (n,) of the known values in the newest ``window`` rows of x (n,), or NaN."""
    known = np.isfinite(x)
    sums = [np.cumsum(np.where(known, x, 0.0)), np.cumsum(known, dtype=float)]
    total, count = (c - np.concatenate([np.zeros(window), c])[: len(c)] for c in sums)
    return np.where(count > 0.0, total / np.maximum(count, 1.0), np.nan)


def flown_in(mode: float, rows: SampleBlock) -> SampleBlock:
    """Return the rows with this flight mode in all of them."""
    return replace(rows, mode=np.full(len(rows), mode))
