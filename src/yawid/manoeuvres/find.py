"""The search for manoeuvres: samples in, the samples of each manoeuvre out when it has ended.

A manoeuvre begins 1 s before the rudder's own part first leaves its rest position, and ends when
that part has rested for 5 s and the yaw rate has decayed, or after 15 s of rest. So it contains the
free decay. Decisions are made for each second of the grid, from the samples until then: where a
stream is cut into blocks changes nothing.
"""

from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np

from yawid.blocks import WINDOW_S, Bools, Floats, Ints, SampleBlock, shifted
from yawid.manoeuvres.candidate import MOVES, Candidate, UnderWay, flown_in, moved_within
from yawid.results.excitation import (
    CHUNK_S,
    MODE_LATE_S,
    REACH_S,
    ROWS_PER_LAG,
    mix,
)

LEAD_S = 1.0
"""The time in s that a manoeuvre has before its first movement."""
STRIDE_S = 1.0
"""The time in s between two decisions."""
LONGEST_GAP_S = 2.0
"""The longest gap without a usable sample, in s, that a manoeuvre may have."""
LONGEST_STATED_S = 600.0
"""A stretch given by --from and --to is one manoeuvre if it is not longer than this, in s."""


class Stated:
    """A stretch that the user named: all its samples are one manoeuvre, however it was flown."""

    def __init__(self) -> None:
        self._kept: list[SampleBlock] = []

    def feed(self, samples: SampleBlock) -> list[SampleBlock]:
        """Keep the samples."""
        self._kept.append(samples)
        return []

    def progress(self, *, closely: bool) -> UnderWay:
        """Return the progress of the stretch; ``closely`` makes no difference."""
        return UnderWay.of(self._kept, is_excited=True) if self._kept else UnderWay()

    def finish(self) -> list[SampleBlock]:
        """Return the manoeuvre, if it has any sample."""
        kept, self._kept = self._kept, []
        return [SampleBlock.joined(kept)] if kept else []


class Finder:
    """The search for manoeuvres; ``travel_unit`` is half the rudder's travel in the unit of ``u``.

    ``is_bare`` returns whether only the sticks move the surfaces in a flight mode. The samples that
    are kept are bounded: 120 s of a manoeuvre and about 26 s to compare with.
    """

    def __init__(
        self,
        sample_time_s: float,
        travel_unit: float,
        is_bare: Callable[[float], bool] | None = None,
    ) -> None:
        self._is_bare = is_bare
        self._section = _Section(sample_time_s, travel_unit)
        self._longest = round(LONGEST_GAP_S / sample_time_s)
        self._last: SampleBlock | None = None
        self._used_k = 0
        self._lost = False

    def feed(self, samples: SampleBlock) -> list[SampleBlock]:
        """Take samples in; return the manoeuvres that end with them, each as one block."""
        found: list[SampleBlock] = []
        broken, of_mode = self._breaks(samples)
        edges = [0, *np.flatnonzero(broken | of_mode).tolist(), len(samples)]
        for i, (first, stop) in enumerate(pairwise(edges)):
            if i > 0 and broken[first]:
                found += self._section.finish()
            elif i > 0:
                mode = float(samples.mode[first])
                is_bare = self._is_bare is not None and self._is_bare(mode)
                found += self._section.change_mode(mode, is_bare=is_bare)
            if stop > first:
                found += self._section.feed(samples.select(slice(first, stop)))
        return found

    def finish(self) -> list[SampleBlock]:
        """Return the manoeuvre that was still under way at the last sample, if there is one."""
        return self._section.finish()

    def progress(self, *, closely: bool) -> UnderWay:
        """Return the progress of the current manoeuvre, ``closely`` with the rudder's movement."""
        return self._section.progress(closely=closely)

    def _breaks(self, samples: SampleBlock) -> tuple[Bools, Bools]:
        """Return two masks (n,): the rows at a break, and the rows at a change of flight mode.

        No manoeuvre may reach across a break, which is more than 2 s without a usable sample,
        another boot, or another meaning of the channels.
        """
        last = self._last or samples.select(slice(0, 1))
        known, before = np.nan_to_num(samples.mode, nan=-1.0), np.nan_to_num(last.mode, nan=-1.0)
        of_mode: Bools = np.diff(known, prepend=before) != 0.0
        broken: Bools = np.diff(samples.epoch, prepend=last.epoch) != 0
        rebooted = np.diff(samples.k, prepend=last.k) < 0
        used = samples.held == 0
        # The beginning of a boot ends no gap: its k starts again.
        anchors = np.where(used | rebooted, np.arange(len(used)), -1)
        newest = np.maximum.accumulate(np.concatenate([[-1], anchors[:-1]]))
        carried = last.k[0] if self._last is None else self._used_k
        since = samples.k - np.where(newest >= 0, samples.k[newest], carried)
        lost = ~rebooted & (since > self._longest)
        broken |= rebooted | lost & (used | ~np.concatenate([[self._lost], lost[:-1]]))
        self._last, self._lost = samples.select(slice(-1, None)), bool(lost[-1])
        final = int(np.maximum.accumulate(anchors)[-1])
        self._used_k = int(samples.k[final]) if final >= 0 else int(carried)
        return broken, of_mode


class _Section:
    """The search within a section: samples of one boot, meaning and flight mode, no long gap."""

    def __init__(self, sample_time_s: float, travel_unit: float) -> None:
        self._ts_s = sample_time_s
        self._unit = travel_unit
        self._stride = max(1, round(STRIDE_S / sample_time_s))
        self._reach = max(1, round(REACH_S / sample_time_s))
        self._window = max(2, round(WINDOW_S / sample_time_s))
        self._chunk = max(round(CHUNK_S / sample_time_s), ROWS_PER_LAG * (2 * self._reach + 2))
        self._lead = round(LEAD_S / sample_time_s)
        self._late = round(MODE_LATE_S / sample_time_s)
        self._start()

    def _start(self) -> None:
        self._undecided: list[SampleBlock] = []
        self._before: SampleBlock | None = None
        self._earlier: SampleBlock | None = None
        self._past = np.empty((0, 3))
        self._next_stride: int | None = None
        self._decided_k = 0
        self._open: Candidate | None = None

    def feed(self, samples: SampleBlock) -> list[SampleBlock]:
        """Take samples of the section in; return the manoeuvres that end with them."""
        if self._next_stride is None:
            self._decided_k = int(samples.k[0]) - 1
            self._next_stride = (int(samples.k[0]) // self._stride + 1) * self._stride
        self._undecided.append(samples)
        found: list[SampleBlock] = []
        newest_k = int(samples.k[-1])
        self._pass_rest(newest_k)
        while self._next_stride + self._reach <= newest_k:
            found += self._step(range(self._next_stride - 1, newest_k - self._reach, self._stride))
            self._pass_rest(newest_k)
        return found

    def change_mode(self, mode: float, *, is_bare: bool) -> list[SampleBlock]:
        """Return the manoeuvres that a change of flight mode ends.

        A manoeuvre that has just begun goes on if the new mode is bare: a HEARTBEAT reports a mode
        up to 1.5 s late, and ArduPilot's plane-doublets.lua changes to MANUAL, a bare mode, and
        moves the rudder at once. All of such a manoeuvre was flown in MANUAL.
        """
        if not is_bare:
            return self.finish()
        found = []
        if self._open is not None and self._open.rings:
            found = self._end(gives_back=True)
        newest_k = int(self._undecided[-1].k[-1]) if self._undecided else self._decided_k
        if self._open is None and not self._moves_now():
            found += self._decide_rest()
            lead = self._before
            self._start()
            self._earlier = None if lead is None else flown_in(mode, lead)
            return found
        if newest_k - self._reach > self._decided_k:
            found += self._step([newest_k - self._reach], is_last=True)
        # How the newest rows follow the aileron is not known yet: they count for the new mode.
        left = [flown_in(mode, rows) for rows in self._undecided]
        if self._open is not None and newest_k - self._open.began_k < self._late:
            self._open.flown_in(mode)
            self._undecided = left
            self._next_stride = (self._decided_k // self._stride + 1) * self._stride
            return found
        lead, self._undecided = self._before, []
        found += self.finish()
        self._before = None if lead is None else flown_in(mode, lead)
        for rows in left:
            found += self.feed(rows)
        return found

    def _moves_now(self) -> bool:
        """Return whether the rudder moves in the rows that are not decided yet."""
        moved = [_measured(rows, self._unit)[:, 1] for rows in self._undecided]
        known = np.concatenate([x[np.isfinite(x)] for x in moved]) if moved else np.empty(0)
        return len(known) > 0 and float(np.ptp(known)) > MOVES

    def _decide_rest(self) -> list[SampleBlock]:
        if not self._undecided:
            return []
        return self._step([int(self._undecided[-1].k[-1])], is_last=True)

    def finish(self) -> list[SampleBlock]:
        """Return the manoeuvres that end with the section; the next sample opens a new section."""
        found = self._decide_rest()
        if self._open is not None and self._open.is_excited:
            found.append(self._open.samples())
        self._start()
        return found

    def _pass_rest(self, newest_k: int) -> None:
        """Decide on all strides in which the rudder rests at once: they are most of a flight."""
        assert self._next_stride is not None  # there are samples
        end = (newest_k - self._reach) // self._stride * self._stride
        if self._open is not None or end <= self._next_stride:
            return
        rows = SampleBlock.joined(self._undecided)
        seen = np.concatenate([self._past, _measured(rows, self._unit)])
        table = _on_grid(seen, self._decided_k - self._window + 2, end)
        moving = np.flatnonzero(moved_within(table[:, 0], self._window)[self._window - 1 :] > MOVES)
        if len(moving):
            end = (self._decided_k + 1 + int(moving[0])) // self._stride * self._stride
        if end >= self._next_stride:
            self._decide(rows, seen, end - 1)
            self._next_stride = end + self._stride

    def _step(self, ends: Sequence[int], *, is_last: bool = False) -> list[SampleBlock]:
        """Decide on the samples up to each of ``ends`` in turn, the k of a last sample.

        What comes after an end only serves to look ahead from it. After an end before which the
        rudder rests the others are left to :meth:`_pass_rest`.
        """
        rows = SampleBlock.joined(self._undecided)
        seen = np.concatenate([self._past, _measured(rows, self._unit)])
        strokes, decided_k = [np.empty(0)], self._decided_k
        for last_k in ends:
            self._next_stride = last_k + 1 + self._stride
            k = rows.k[slice(*np.searchsorted(rows.k, (decided_k, last_k), side="right"))]
            whole = self._whole(seen, k, last_k)
            rests = whole.max(initial=0.0) <= MOVES
            stroke = whole if rests else self._own_stroke(seen, k, last_k, whole)
            # The wait is limited, because an aileron may be known only now and then.
            if stroke is not None or is_last or last_k - decided_k > self._chunk:
                strokes.append(np.zeros(len(k)) if stroke is None else stroke)
                decided_k = last_k
            if rests:
                break
        return self._decide(rows, seen, decided_k, np.concatenate(strokes))

    def _decide(
        self, rows: SampleBlock, seen: Floats, last_k: int, stroke: Floats | None = None
    ) -> list[SampleBlock]:
        """Mark the rows up to ``last_k`` as decided; without a stroke (n,) the rudder rests."""
        count = int(np.searchsorted(rows.k, last_k, side="right"))
        decided, rest = rows.select(slice(0, count)), rows.select(slice(count, None))
        self._undecided = [rest] if len(rest) else []
        oldest = last_k - self._chunk - self._window
        self._past = seen[slice(*np.searchsorted(seen[:, 0], (oldest, last_k + 1)))]
        self._decided_k = last_k
        return self._follow(decided, np.zeros(count) if stroke is None else stroke)

    def _whole(self, seen: Floats, k: Ints, last_k: int) -> Floats:
        """Return how far the rudder moved within 5 s at each row ``k`` (n,) up to ``last_k``."""
        if not len(k):
            return np.empty(0)
        oldest = int(k[0]) - self._window + 1
        newest = _on_grid(seen, oldest, last_k + 1)[:, 0]
        return moved_within(newest, self._window)[k - oldest]

    def _own_stroke(self, seen: Floats, k: Ints, last_k: int, whole: Floats) -> Floats | None:
        """Return the stroke (n,) of the rudder's own part within 5 s, at each row ``k`` (n,).

        It is a part of half the travel, and that of the ``whole`` rudder at most. None while too
        little is known of how the rudder follows the aileron; where the aileron is unknown, the
        whole rudder is its own part.
        """
        first_k = last_k - self._chunk - self._window
        oldest = max(int(k[0]) - self._window + 1 - first_k, 0)
        own = self._own(seen, first_k, slice(oldest, last_k - first_k + 1))
        if own is None:
            return None
        return np.minimum(moved_within(own, self._window)[k - first_k - oldest], whole)

    def _own(self, seen: Floats, first_k: int, rows: slice) -> Floats | None:
        """Return the rudder's own part (rows,) at these rows of the grid from ``first_k`` on.

        None while too little is known of how it follows the aileron; without an aileron that moves
        it is the whole rudder.
        """
        rudder, aileron = _on_grid(seen, first_k, first_k + rows.stop + self._reach).T
        known = aileron[np.isfinite(aileron)]
        if not len(known) or float(np.ptp(known)) == 0.0:
            return np.asarray(rudder[rows], np.float64)
        lags = [shifted(aileron, i) for i in range(-self._reach, self._reach + 1)]
        columns = np.column_stack([*lags, np.ones(len(rudder))])
        good = np.isfinite(columns).all(axis=1) & np.isfinite(rudder)
        used = np.flatnonzero(good[: rows.stop])[-self._chunk :]
        if len(used) < ROWS_PER_LAG * columns.shape[1]:
            return None
        # The constant is not subtracted: it drifts as the window slides, which is no movement.
        coefficients = mix(columns[used], rudder[used])[:-1]
        own = rudder[rows] - columns[rows, :-1] @ coefficients
        return np.asarray(own, np.float64)

    def progress(self, *, closely: bool) -> UnderWay:
        """Return the progress: see :class:`Finder`."""
        found = UnderWay() if self._open is None else self._open.progress()
        if not closely:
            return found
        seen = np.concatenate([self._past, *(_measured(b, self._unit) for b in self._undecided)])
        if not len(seen) or seen[-1, 0] - self._reach < seen[0, 0]:
            return found
        last_k = int(seen[-1, 0]) - self._reach
        first_k = int(max(seen[0, 0], last_k - self._chunk - self._window))
        rows = slice(max(last_k - first_k + 1 - self._window, 0), last_k - first_k + 1)
        whole = _on_grid(seen, first_k + rows.start, last_k + 1)[:, 0]
        own = whole if _reached(whole) <= MOVES else self._own(seen, first_k, rows)
        if own is None:
            return found
        stroke = min(_reached(own), _reached(whole))
        return found._replace(stroke=stroke, rests_s=_rests(own) * self._ts_s)

    def _follow(self, rows: SampleBlock, stroke: Floats) -> list[SampleBlock]:
        """Open and continue manoeuvres by decided rows' strokes (n,); return those that end."""
        found: list[SampleBlock] = []
        at = 0
        while at < len(rows):
            if self._open is None:
                moves = np.flatnonzero(stroke[at:] > MOVES)
                first = at + int(moves[0]) if len(moves) else len(rows)
                self._remember(rows.select(slice(at, first)))
                at = first
                if first < len(rows):
                    began_k = int(rows.k[first])
                    self._open = Candidate(self._ts_s, self._lead_of(began_k), began_k)
                continue
            taken, is_over = self._open.feed(rows.select(slice(at, None)), stroke[at:])
            at += taken
            if is_over:
                moves_again = at < len(rows) and stroke[at] > MOVES
                found += self._end(gives_back=moves_again)
        return found

    def _end(self, *, gives_back: bool) -> list[SampleBlock]:
        """End the manoeuvre under way and return it if it is one.

        With ``gives_back`` the newest second of its wait for the decay is kept for the next one.
        """
        assert self._open is not None
        waited = self._open.rings and gives_back
        self._before = self._open.given_back(self._lead) if waited else None
        found = [self._open.samples()] if self._open.is_excited else []
        self._open = None
        return found

    def _lead_of(self, began_k: int) -> SampleBlock | None:
        """Return the second before a manoeuvre, also from an earlier mode that has just ended."""
        earlier, self._earlier = self._earlier, None
        if earlier is None or began_k - int(earlier.k[-1]) > self._reach:
            return self._before
        return earlier if self._before is None else SampleBlock.joined([earlier, self._before])

    def _remember(self, rows: SampleBlock) -> None:
        """Keep the newest second of these rows: the next manoeuvre begins with it."""
        if len(rows):
            older_k = rows.k[-1] - self._lead
            if self._before is not None and rows.k[0] > older_k + 1:
                rows = SampleBlock.joined([self._before, rows])
            self._before = rows.select(slice(int(np.searchsorted(rows.k, older_k + 1)), None))


def _measured(rows: SampleBlock, unit: float) -> Floats:
    """Return k, the rudder in half travels, NaN where held, and the aileron, (n, 3)."""
    rudder = np.where(rows.held == 0, rows.u[:, 0] / unit, np.nan)
    return np.column_stack([rows.k, rudder, rows.aileron])


def _on_grid(seen: Floats, first_k: int, stop_k: int) -> Floats:
    """Return rudder and aileron (stop_k - first_k, 2) from rows (n, 3), NaN where there is none."""
    table = np.full((stop_k - first_k, 2), np.nan)
    inside = seen[slice(*np.searchsorted(seen[:, 0], (first_k, stop_k)))]
    table[inside[:, 0].astype(np.int64) - first_k] = inside[:, 1:]
    return table


def _reached(x: Floats) -> float:
    """Return how far x (n,) moved in all, by its known values."""
    known = x[np.isfinite(x)]
    return float(np.ptp(known)) if len(known) else 0.0


def _rests(own: Floats) -> int:
    """Return over how many rows at its end ``own`` (n,) moved by no more than ``MOVES``."""
    newest_first, known = own[::-1], np.isfinite(own[::-1])
    high = np.maximum.accumulate(np.where(known, newest_first, -np.inf))
    low = np.minimum.accumulate(np.where(known, newest_first, np.inf))
    moved = np.flatnonzero(high - low > MOVES)
    return int(moved[0]) if len(moved) else len(own)
