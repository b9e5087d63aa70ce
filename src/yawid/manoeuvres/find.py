"""Where the manoeuvres of a flight are: samples in, the samples of each manoeuvre out as it ends.

A manoeuvre begins 1 s before the rudder's own part first leaves where it stood, and ends when that
has rested for 5 s; the free decay is in it. Decisions are made second by second of the grid, from
what came until then: where a stream is cut into blocks changes nothing.
"""

from collections.abc import Callable
from itertools import pairwise

import numpy as np

from yawid.blocks import WINDOW_S, Bools, Floats, SampleBlock, extremes, shifted
from yawid.manoeuvres.candidate import MOVES, Candidate, UnderWay, flown_in
from yawid.results.excitation import (
    CHUNK_S,
    MODE_LATE_S,
    REACH_S,
    ROWS_PER_LAG,
    mix,
)

LEAD_S = 1.0
"""What comes before the first movement, in s."""
STRIDE_S = 1.0
LONGEST_GAP_S = 2.0
LONGEST_STATED_S = 600.0
"""A stretch named by --from and --to is one manoeuvre up to this length."""


class Stated:
    """One stretch that was named: all its samples are one manoeuvre, however it was flown."""

    def __init__(self) -> None:
        self._kept: list[SampleBlock] = []

    def feed(self, samples: SampleBlock) -> list[SampleBlock]:
        """Keep the samples."""
        self._kept.append(samples)
        return []

    def progress(self, *, closely: bool) -> UnderWay:
        """Return how the stretch stands; it need not be looked at ``closely``."""
        return UnderWay.of(self._kept, is_excited=True) if self._kept else UnderWay()

    def finish(self) -> list[SampleBlock]:
        """Return the manoeuvre, if there is one sample of it."""
        kept, self._kept = self._kept, []
        return [SampleBlock.joined(kept)] if kept else []


class Finder:
    """Finds manoeuvres; ``travel_unit`` is half the rudder's travel in the unit of ``u``.

    ``is_bare`` tells of a flight mode whether the sticks alone move the surfaces in it. What is
    kept is bounded: 120 s of a manoeuvre and 26 s to compare with.
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
        """Take samples in; return the manoeuvres that they end, each as a block of its own."""
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
        """Return the manoeuvre that the end of the samples ends, if there is one."""
        return self._section.finish()

    def progress(self, *, closely: bool) -> UnderWay:
        """Return how the manoeuvre on its way stands, ``closely`` with how the rudder moved."""
        return self._section.progress(closely=closely)

    def _breaks(self, samples: SampleBlock) -> tuple[Bools, Bools]:
        """Return at which rows (n,) something ends that a manoeuvre must not reach across.

        That is 2 s without a sample that can be used, another boot, another meaning of the
        channels; and, in the second place, another flight mode.
        """
        last = self._last or samples.select(slice(0, 1))
        known, before = np.nan_to_num(samples.mode, nan=-1.0), np.nan_to_num(last.mode, nan=-1.0)
        of_mode: Bools = np.diff(known, prepend=before) != 0.0
        broken: Bools = np.diff(samples.epoch, prepend=last.epoch) != 0
        rebooted = np.diff(samples.k, prepend=last.k) < 0
        used = samples.held == 0
        # Of a boot that begins, what came before it is no gap: its k counts anew.
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
    """Samples of one boot and meaning without a long gap between them, and of one flight mode."""

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
        """Take samples of the section in; return the manoeuvres that they end."""
        if self._next_stride is None:
            self._decided_k = int(samples.k[0]) - 1
            self._next_stride = (int(samples.k[0]) // self._stride + 1) * self._stride
        self._undecided.append(samples)
        found: list[SampleBlock] = []
        self._pass_rest(int(samples.k[-1]))
        while self._next_stride + self._reach <= samples.k[-1]:
            was_open = self._open is not None
            found += self._step(self._next_stride - 1)
            # Over a gap there may be strides without a sample.
            self._next_stride += self._stride
            if was_open:
                self._pass_rest(int(samples.k[-1]))
        return found

    def change_mode(self, mode: float, *, is_bare: bool) -> list[SampleBlock]:
        """Return what the change to a flight mode ends: not a manoeuvre that has just begun.

        A HEARTBEAT tells a mode up to 1.5 s late. ArduPilot's plane-doublets.lua changes to MANUAL,
        a bare mode, and moves the rudder at once: all of such a manoeuvre was flown in MANUAL.
        """
        if not is_bare:
            return self.finish()
        newest_k = int(self._undecided[-1].k[-1]) if self._undecided else self._decided_k
        if self._open is None and not self._moves_now():
            found = self._decide_rest()
            lead = self._before
            self._start()
            self._earlier = None if lead is None else flown_in(mode, lead)
            return found
        found = []
        if newest_k - self._reach > self._decided_k:
            found = self._step(newest_k - self._reach, is_last=True)
        # How the newest rows follow the aileron is not known yet: the new mode decides on them.
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
        """Tell whether the rudder moves in the rows that are not decided on."""
        moved = [_measured(rows, self._unit)[:, 1] for rows in self._undecided]
        known = np.concatenate([x[np.isfinite(x)] for x in moved]) if moved else np.empty(0)
        return len(known) > 0 and float(np.ptp(known)) > MOVES

    def _decide_rest(self) -> list[SampleBlock]:
        if not self._undecided:
            return []
        return self._step(int(self._undecided[-1].k[-1]), is_last=True)

    def finish(self) -> list[SampleBlock]:
        """Return what the section's end ends; the next sample opens another one."""
        found = self._decide_rest()
        if self._open is not None and self._open.is_excited:
            found.append(self._open.samples())
        self._start()
        return found

    def _pass_rest(self, newest_k: int) -> None:
        """Decide at once on the strides in which the rudder rests: most of most flights."""
        assert self._next_stride is not None  # there are samples
        end = (newest_k - self._reach) // self._stride * self._stride
        if self._open is not None or end <= self._next_stride:
            return
        rows = SampleBlock.joined(self._undecided)
        seen = np.concatenate([self._past, _measured(rows, self._unit)])
        table = _on_grid(seen, self._decided_k - self._window + 2, end)
        moving = np.flatnonzero(_stroke(table[:, 0], self._window)[self._window - 1 :] > MOVES)
        if len(moving):
            end = (self._decided_k + 1 + int(moving[0])) // self._stride * self._stride
        if end >= self._next_stride:
            self._decide(rows, end - 1, None)
            self._next_stride = end + self._stride

    def _step(self, last_k: int, *, is_last: bool = False) -> list[SampleBlock]:
        """Decide on the samples up to ``last_k``; those after it are only looked ahead to."""
        rows = SampleBlock.joined(self._undecided)
        stroke = self._strokes(rows, last_k)
        # An aileron that is known now and then only would be waited for without end.
        if stroke is None and not is_last and last_k - self._decided_k <= self._chunk:
            return []
        return self._decide(rows, last_k, stroke)

    def _decide(self, rows: SampleBlock, last_k: int, stroke: Floats | None) -> list[SampleBlock]:
        """Take the rows up to ``last_k`` as decided; without a stroke (n,) they are at rest."""
        count = int(np.searchsorted(rows.k, last_k, side="right"))
        decided, rest = rows.select(slice(0, count)), rows.select(slice(count, None))
        self._undecided = [rest] if len(rest) else []
        self._past = np.concatenate([self._past, _measured(decided, self._unit)])
        oldest = last_k - self._chunk - self._window
        self._past = self._past[np.searchsorted(self._past[:, 0], oldest) :]
        self._decided_k = last_k
        if not count:
            return []
        return self._follow(decided, np.zeros(count) if stroke is None else stroke[:count])

    def _strokes(self, rows: SampleBlock, last_k: int) -> Floats | None:
        """Return the stroke of the own part within 5 s at each row up to ``last_k``, (n,).

        In parts of half the travel. None while too little is known of how the rudder follows the
        aileron; where the aileron is not known the whole rudder is its own.
        """
        seen = np.concatenate([self._past, _measured(rows, self._unit)])
        first_k = int(max(seen[0, 0], last_k - self._chunk - self._window))
        places = rows.k[rows.k <= last_k] - first_k
        if not len(places):
            return np.empty(0)
        oldest = max(int(places[0]) - self._window + 1, 0)
        end = last_k - first_k + 1
        newest = _on_grid(seen, first_k + oldest, last_k + 1)[:, 0]
        whole = _stroke(newest, self._window)[places - oldest]
        if whole.max() <= MOVES:
            return whole
        own = self._own(seen, first_k, slice(oldest, end))
        if own is None:
            return None
        return np.minimum(_stroke(own, self._window)[places - oldest], whole)

    def _own(self, seen: Floats, first_k: int, rows: slice) -> Floats | None:
        """Return the rudder's own part at some rows of the grid from ``first_k`` on, (rows,).

        None while too little is known of how it follows the aileron; without one it is all of it.
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
        # The constant stays in: it drifts as the window slides, and that is no movement.
        coefficients = mix(columns[used], rudder[used])[:-1]
        own = rudder[rows] - columns[rows, :-1] @ coefficients
        return np.asarray(own, np.float64)

    def progress(self, *, closely: bool) -> UnderWay:
        """See :class:`Finder`."""
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
        """Open, continue and end manoeuvres by the strokes (n,) of decided rows."""
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
                found += [self._open.samples()] if self._open.is_excited else []
                self._open, self._before = None, None
        return found

    def _lead_of(self, began_k: int) -> SampleBlock | None:
        """Return the second before: of the earlier mode too, where it moves as this one begins."""
        earlier, self._earlier = self._earlier, None
        if earlier is None or began_k - int(earlier.k[-1]) > self._reach:
            return self._before
        return earlier if self._before is None else SampleBlock.joined([earlier, self._before])

    def _remember(self, rows: SampleBlock) -> None:
        """Keep the newest second, with which a manoeuvre begins."""
        if len(rows):
            older_k = rows.k[-1] - self._lead
            if self._before is not None and rows.k[0] > older_k + 1:
                rows = SampleBlock.joined([self._before, rows])
            self._before = rows.select(slice(int(np.searchsorted(rows.k, older_k + 1)), None))


def _measured(rows: SampleBlock, unit: float) -> Floats:
    """Return k, the rudder in half travels and the aileron, (n, 3), NaN where it is held."""
    rudder = np.where(rows.held == 0, rows.u[:, 0] / unit, np.nan)
    return np.column_stack([rows.k, rudder, rows.aileron])


def _on_grid(seen: Floats, first_k: int, stop_k: int) -> Floats:
    """Return rudder and aileron (stop_k - first_k, 2) of rows (n, 3), NaN where there is none."""
    table = np.full((stop_k - first_k, 2), np.nan)
    inside = seen[slice(*np.searchsorted(seen[:, 0], (first_k, stop_k)))]
    table[inside[:, 0].astype(np.int64) - first_k] = inside[:, 1:]
    return table


def _stroke(x: Floats, window: int) -> Floats:
    """Return how far x (n,) moved within the last ``window`` rows, of what is known of them."""
    known, before = np.isfinite(x), np.full(window - 1, np.inf)
    high = extremes(np.maximum, np.concatenate([-before, np.where(known, x, -np.inf)]), window)
    low = extremes(np.minimum, np.concatenate([before, np.where(known, x, np.inf)]), window)
    return np.asarray(np.maximum(high - low, 0.0), np.float64)


def _reached(x: Floats) -> float:
    """Return how far x (n,) moved, of what is known of it."""
    known = x[np.isfinite(x)]
    return float(np.ptp(known)) if len(known) else 0.0


def _rests(own: Floats) -> int:
    """Return for how many rows at its end ``own`` (n,) has moved by no more than ``MOVES``."""
    newest_first, known = own[::-1], np.isfinite(own[::-1])
    high = np.maximum.accumulate(np.where(known, newest_first, -np.inf))
    low = np.minimum.accumulate(np.where(known, newest_first, np.inf))
    moved = np.flatnonzero(high - low > MOVES)
    return int(moved[0]) if len(moved) else len(own)
