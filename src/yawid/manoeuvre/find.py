"""Where manoeuvres are: samples in, the samples of each manoeuvre out when it has ended.

The flight is judged in whole seconds of the grid. What decides on a second is

    o(k) = u(k) - sum over |i| <= 0.3 s of c_i a(k - i)      the rudder's own part, in half travels
    S    = max o - min o over the newest 5 s                 its stroke
    R    = max r - min r over the newest 4 s                 the swing of the yaw rate

where c is the ridge regression of the rudder u on the aileron a over the newest 20 s. A second of
which c is not known yet waits for it, up to 20 s: where a manoeuvre begins is decided late rather
than wrong. There are three states:

    rests   S <= 0.04. A second with more begins a manoeuvre, which has a second of rest before it.
    moves   S > 0.04. It is a manoeuvre if S reaches 0.1.
    rings   S <= 0.04 again: the rudder has rested for 5 s. A movement goes back to "moves". The
            manoeuvre ends when 2.5 periods of r have passed since the rest began, or when R is
            below a tenth of its largest value.

The period is twice the mean time between the zero crossings of r since the rest began. It counts as
15 s where there are fewer than two, or if they are farther apart. So half a doublet of a mode of
0.5 rad/s, 6.3 s of a rudder held to one side, is no end: r has crossed zero once at most.

A manoeuvre also ends after 120 s and with another airspeed, and it never reaches across a break:
more than 2 s without a usable sample, another boot, another meaning of the rudder, another flight
mode. Where a stream is cut into blocks changes nothing, and what is kept of it is bounded.
"""

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from yawid.blocks import AIRSPEED_SHARE, LEAST_TRAVEL, Bools, Floats, SampleBlock, extremes
from yawid.results.excitation import (
    CHUNK_S,
    LEAST_STROKE,
    MODE_LATE_S,
    REACH_S,
    ROWS_PER_LAG,
    mix,
)

MOVES: Final = 2.0 * LEAST_TRAVEL
"""A rudder with a greater stroke moves. Servo noise and the rounding of PWM are half of it: without
it they would keep manoeuvres from ending."""
REST: Final = 5
"""The seconds of rest that end a movement, and the window of a stroke: without them each step of a
3-2-1-1 would be an end."""
DECAYED, DECAY = 0.1, 4
"""r has decayed where it swings within so many seconds by no more than this part of its largest
swing. Without it every calm flight would wait for 2.5 periods that it no longer shows."""
PERIODS, LONGEST_PERIOD_S = 2.5, 15.0
"""The periods that a manoeuvre has of the free decay, which an answer needs in all, and the longest
period. With answers from 2 of them the errors of wn in gusts were 3.6 % instead of 3.0 (RMS), and a
light mode of 0.5 rad/s had half a period of its decay without them; without the longest one a turn,
in which r crosses no zero, would be waited for to its end."""
CLEAR: Final = 0.15
"""r has crossed zero, its median since the rest, where it goes on to this part of its newest swing.
Without it noise is a crossing: with 0.1, 2 of 144 simulated releases (0.5 to 1 rad/s, noise of 3 %)
lost a part of their decay. With 0.3 gusts hide crossings: of 192 simulated doublets every 15 s at
2 rad/s 176 were a manoeuvre of their own, and 191 with 0.15."""
LONGEST_S: Final = 120.0
"""The longest manoeuvre in s. Without it a rudder that never rests would be one without an end."""
LONGEST_GAP_S: Final = 2.0
"""The longest gap without a usable sample, in s, that a manoeuvre may have: in a longer one the
rudder may have moved. Carried over from the earlier finder."""
LONGEST_STATED_S: Final = 600.0
"""A stretch given by --from and --to is one manoeuvre if it is not longer than this, in s: without
it a whole flight that is named would be one. Carried over from the earlier finder."""
OTHER_SPEED, SPEED_S = 1.3, 2.0
"""The largest factor between first and last airspeed, means over so many s, as a gust is shorter.
Beyond it, as in a take-off or a landing, an answer would hold for neither of the two."""
RUDDER, AILERON, SPEED, YAW = 0, 1, 4, (2, 3)
"""Columns of the grid; the yaw rate is there as it is, and without the turn that the bank makes."""


class UnderWay(NamedTuple):
    """The progress of a manoeuvre that may be under way, for display: it changes no result.

    ``stroke`` is how far the rudder's own part moved within 5 s, as a part of half its travel, None
    where too little is known of how it follows the aileron; ``rests_s`` is how long it has rested.
    Both are those of the newest whole second. If a manoeuvre is being recorded,
    ``from_s`` is its beginning in s since boot, ``lasted_s`` its length so far, and ``is_excited``
    whether the rudder moved far enough for an answer.
    """

    stroke: float | None = None
    rests_s: float = 0.0
    from_s: float | None = None
    lasted_s: float = 0.0
    is_excited: bool = False


class Finder:
    """The search for manoeuvres; ``travel_unit`` is half the rudder's travel in the unit of ``u``.

    ``is_bare`` returns whether only the sticks move the surfaces in a flight mode. With
    ``is_stated`` the user named the stretch: all samples are one manoeuvre, however it was flown.
    ``most_whole`` is the largest stroke of the rudder seen, and ``most_own`` that of its own part
    that makes no manoeuvre: they say why nothing was found, see :func:`excitation_reasons`.
    """

    def __init__(
        self,
        sample_time_s: float,
        travel_unit: float,
        is_bare: Callable[[float], bool] | None = None,
        *,
        is_stated: bool = False,
    ) -> None:
        self.is_stated = is_stated
        self._ts_s, self._unit, self._is_bare = sample_time_s, travel_unit, is_bare
        self._second = max(1, round(1.0 / sample_time_s))
        self._rest = REST * self._second
        self._reach = max(1, round(REACH_S / sample_time_s))
        self._chunk = max(round(CHUNK_S / sample_time_s), ROWS_PER_LAG * (2 * self._reach + 2))
        self._last: SampleBlock | None = None
        self._clock = self._used_at = 0
        self.most_whole = self.most_own = 0.0
        self._restart()

    def _restart(self) -> None:
        """Forget all samples: the next one begins a section, in which there is no break."""
        self._kept: list[SampleBlock] = []
        self._free_k = self._next_k = self._looked_k = self._moved_k = 0
        self._stroke: float | None = 0.0
        self._rested = 0
        self._close()

    def _close(self) -> None:
        self._start_k: int | None = None
        self._rests_k: int | None = None
        self._is_excited = False
        self._most = np.zeros(2)

    def feed(self, samples: SampleBlock) -> list[SampleBlock]:
        """Take samples in; return the manoeuvres that end with them, each as one block."""
        if self.is_stated:
            self._kept.append(samples)
            return []
        found: list[SampleBlock] = []
        broken, of_mode = self._breaks(samples)
        edges = {0, *np.flatnonzero(broken | of_mode).tolist(), len(samples)}
        for first, stop in pairwise(sorted(edges)):
            if broken[first]:
                found += self.finish()
            elif of_mode[first]:
                found += self._change_mode(float(samples.mode[first]), int(samples.k[first]))
            found += self._take(samples.select(slice(first, stop)))
        return found

    def finish(self) -> list[SampleBlock]:
        """Return the manoeuvres that end with the last sample; the next one begins a section."""
        found = []
        if self.is_stated and self._kept:
            found.append(SampleBlock.joined(self._kept))
        elif self._kept:
            found += self._advance(is_last=True)
            found += self._end(self._next_k)
        self._restart()
        return found

    def progress(self) -> UnderWay:
        """Return the progress of the current manoeuvre."""
        found = UnderWay(self._stroke, self._rested * self._second * self._ts_s)
        if not self._kept or not (self.is_stated or self._start_k is not None):
            return found
        rows, at = self._kept[0], 0
        if self._start_k is not None:
            at = int(np.searchsorted(rows.k, self._start_k))
        low_us, high_us = float(rows.boot_us[at]), float(self._kept[-1].boot_us[-1])
        is_excited = self.is_stated or self._is_excited
        return UnderWay(*found[:2], low_us / 1e6, (high_us - low_us) / 1e6, is_excited)

    def _breaks(self, samples: SampleBlock) -> tuple[Bools, Bools]:
        """Return two masks (n,): the rows at a break, and the rows at a change of flight mode."""
        last = self._last or samples.select(slice(0, 1))
        known, before = np.nan_to_num(samples.mode, nan=-1.0), np.nan_to_num(last.mode, nan=-1.0)
        step = np.diff(samples.k, prepend=last.k)
        broken = (step < 0) | (np.diff(samples.epoch, prepend=last.epoch) != 0)
        clock = self._clock + np.cumsum(np.maximum(step, 1))  # goes on at a reboot
        used = np.flatnonzero(samples.held == 0)
        since = np.diff(clock[used], prepend=self._used_at)
        broken[used] |= since > round(LONGEST_GAP_S / self._ts_s)
        self._last, self._clock = samples.select(slice(-1, None)), int(clock[-1])
        self._used_at = int(clock[used[-1]]) if len(used) else self._used_at
        return broken, np.diff(known, prepend=before) != 0.0

    def _change_mode(self, mode: float, k: int) -> list[SampleBlock]:
        """Return the manoeuvres that a change of flight mode at ``k`` ends.

        A movement that has just begun belongs to the new mode if that is bare: a HEARTBEAT reports
        a mode up to 1.5 s late, and ArduPilot's plane-doublets.lua changes to MANUAL, a bare mode,
        and moves the rudder at once.
        """
        if not self._kept or self._is_bare is None or not self._is_bare(mode):
            return self.finish()
        found = self._advance(is_last=True)
        moves = self._start_k is not None and self._rests_k is None
        if moves and self._moved_k + self._second <= k - round(MODE_LATE_S / self._ts_s):
            cut_k = k  # it moved before the mode can have changed
        else:
            cut_k = max((self._moved_k if moves else k) - self._second, self._free_k)
        found += self._end(cut_k)
        late = self._between(cut_k, k)
        self._restart()
        if len(late):
            found += self._take(replace(late, mode=np.full(len(late), mode)))
        return found

    def _take(self, samples: SampleBlock) -> list[SampleBlock]:
        """Take samples of a section in; return the manoeuvres that end with them."""
        if not self._kept:
            self._free_k = int(samples.k[0])
            self._next_k = self._looked_k = self._free_k // self._second * self._second
        self._kept.append(samples)
        is_due = samples.k[-1] + 1 >= self._looked_k + self._second + self._reach
        return self._advance() if is_due else []

    def _advance(self, *, is_last: bool = False) -> list[SampleBlock]:
        """Decide on all whole seconds of which enough is known; with ``is_last`` on all there are.

        An unknown mix is waited for, but not for longer than its window: an aileron may be known
        only now and then, and then the rudder counts as its copy.
        """
        self._lay_out(is_last=is_last)
        found: list[SampleBlock] = []
        base_k, second = self._next_k, self._second
        stop_k = self._low_k + len(self._grid) - self._reach
        whole = _strokes(self._table(base_k - self._rest + second, stop_k)[:, RUDDER], second)
        self.most_whole = max(self.most_whole, float(whole.max(initial=0.0)))
        for at in range((self._looked_k - base_k) // second, len(whole)):
            self._looked_k += second
            strokes = whole[(self._next_k - base_k) // second : at + 1]
            first_k = self._next_k - self._rest + second
            own: Floats | None = self._table(first_k, self._looked_k)[:, RUDDER]
            if strokes.max() > MOVES:
                own = self._own_part(first_k, self._looked_k)
                waits = self._looked_k - self._next_k <= self._chunk
                if own is None and waits and not (is_last and at + 1 == len(whole)):
                    self._stroke = None
                    continue
                strokes = np.minimum(0.0 if own is None else _strokes(own, second), strokes)
            moves = own is not None and _swing(own[-second:]) > MOVES
            self._rested = 0 if moves else self._rested + len(strokes)
            for stroke in strokes.tolist():
                self._stroke = stroke
                found += self._decide(stroke)
        start_k = self._next_k if self._start_k is None else self._start_k
        oldest_k = min(start_k - self._rest, self._looked_k - self._chunk)
        first = int(np.searchsorted(self._kept[0].k, oldest_k))
        self._kept = [self._kept[0].select(slice(first, None))]
        return found

    def _lay_out(self, *, is_last: bool) -> None:
        """Put the samples onto the grid, whose first k is ``_low_k``; NaN where there is none."""
        rows = SampleBlock.joined(self._kept)
        self._kept = [rows]
        self._low_k = min(int(rows.k[0]), self._next_k - self._rest) - self._reach
        stop_k = int(rows.k[-1]) + 1
        if is_last:  # whole seconds, and what the mix needs after them
            stop_k += -stop_k % self._second + self._reach
        self._grid = np.full((stop_k - self._low_k, 5), np.nan)
        rudder = np.where(rows.held == 0, rows.u[:, 0] / self._unit, np.nan)
        straight = rows.y - np.nan_to_num(rows.turn_rate)
        columns = (rudder, rows.aileron, rows.y, straight, rows.airspeed)
        self._grid[rows.k - self._low_k] = np.column_stack(columns)

    def _table(self, first_k: int, stop_k: int) -> Floats:
        return self._grid[first_k - self._low_k : stop_k - self._low_k]

    def _between(self, first_k: int, stop_k: int) -> SampleBlock:
        rows = self._kept[0]
        return rows.select(slice(*np.searchsorted(rows.k, (first_k, stop_k))))

    def _own_part(self, first_k: int, stop_k: int) -> Floats | None:
        """Return the rudder's own part at each k from ``first_k`` to ``stop_k``.

        None while too little is known of how it follows the aileron; without an aileron that moves
        it is the whole rudder.
        """
        low_k = max(min(first_k, stop_k - self._chunk), self._low_k + self._reach)
        rudder = self._table(low_k, stop_k)[:, RUDDER]
        aileron = self._table(low_k - self._reach, stop_k + self._reach)[:, AILERON]
        newest = slice(first_k - low_k, None)
        if _swing(aileron) == 0.0:
            return rudder[newest]
        lags = sliding_window_view(aileron, 2 * self._reach + 1)
        columns = np.column_stack([lags, np.ones(len(rudder))])
        good = np.flatnonzero(np.isfinite(columns).all(axis=1) & np.isfinite(rudder))
        if len(good) < ROWS_PER_LAG * columns.shape[1]:
            return None
        # The constant is not subtracted: it drifts as the window slides, which is no movement.
        coefficients = mix(columns[good], rudder[good])[:-1]
        return np.asarray(rudder[newest] - lags[newest] @ coefficients, np.float64)

    def _decide(self, stroke: float) -> list[SampleBlock]:
        """Decide on the next second by its stroke; return the manoeuvre that ends, if one does."""
        k, stop_k, found = self._next_k, self._next_k + self._second, []
        self._next_k = stop_k
        if stroke < LEAST_STROKE:
            self.most_own = max(self.most_own, stroke)
        if self._start_k is not None and self._is_other(self._start_k, stop_k):
            found += self._end(k)
        if self._start_k is None:
            if stroke <= MOVES:
                return found
            self._start_k, self._moved_k = max(k - self._second, self._free_k), k
        self._is_excited |= stroke >= LEAST_STROKE
        newest = self._table(max(stop_k - DECAY * self._second, self._start_k), stop_k)
        self._most = np.maximum(self._most, [_swing(newest[:, i]) for i in YAW])
        if stroke > MOVES:
            self._moved_k = self._moved_k if self._rests_k is None else k
            self._rests_k = None
            return found
        if self._rests_k is None:
            self._rests_k = stop_k - self._rest
        rates = self._table(self._rests_k, stop_k)[:, YAW].T
        if not self._is_excited or any(map(self._has_ended, rates, self._most)):
            found += self._end(stop_k)
        return found

    def _has_ended(self, r: Floats, most: float) -> bool:
        """Return whether r (n,) since the rest began shows enough periods, or has decayed."""
        half, decay = 0.5 * LONGEST_PERIOD_S * self._second, DECAY * self._second
        step = max(1, self._second // 4)
        means = r[len(r) % step :].reshape(-1, step).mean(axis=1)
        means = means[np.isfinite(means)]
        if not len(means):
            return True
        away = means - np.median(means)
        clear = np.flatnonzero(np.abs(away) > CLEAR * np.ptp(means[-decay // step :]))
        crossings = clear[1:][np.diff(away[clear] > 0.0)] * step
        if len(crossings) > 1:
            # The lower quartile: a crossing that gusts hide makes three intervals one.
            half = min(float(np.quantile(np.diff(crossings), 0.25)), half)
            decay = max(decay, round(half))
        return len(r) >= 2.0 * PERIODS * half or _swing(r[-decay:]) <= DECAYED * most

    def _is_other(self, start_k: int, stop_k: int) -> bool:
        """Return whether a manoeuvre would be too long or have another airspeed by ``stop_k``."""
        speeds = self._table(start_k, stop_k)[:, SPEED]
        known, newest = (x[np.isfinite(x)] for x in (speeds, speeds[-self._rest :]))
        is_other = stop_k - start_k > round(LONGEST_S / self._ts_s)
        is_other |= speed_factor(known, self._ts_s) > OTHER_SPEED
        if len(newest) and len(speeds) > self._rest:
            mean = float(known.mean())
            is_other |= abs(float(newest.mean()) - mean) > AIRSPEED_SHARE * mean
        return is_other

    def _end(self, stop_k: int) -> list[SampleBlock]:
        """End what is under way before ``stop_k``, and return it if it is a manoeuvre."""
        found = []
        if self._start_k is not None and self._start_k < stop_k and self._is_excited:
            found.append(self._between(self._start_k, stop_k))
            self._free_k = stop_k
        self._close()
        return found


def speed_factor(speeds: Floats, sample_time_s: float) -> float:
    """Return the factor, 1 or more, between the first and the last of airspeeds (n,) in m/s.

    Both are means over 2 s of the known ones; NaN where no more are known.
    """
    known, few = speeds[speeds > 0.0], max(1, round(SPEED_S / sample_time_s))
    if len(known) <= few:
        return np.nan
    first, last = float(known[:few].mean()), float(known[-few:].mean())
    return max(first / last, last / first)


def _strokes(x: Floats, second: int) -> Floats:
    """Return how far x (n,) moved by its known values within 5 whole seconds, at each one's end.

    The first one is that of the fifth second.
    """
    parts = x[: len(x) // second * second].reshape(-1, second)
    high = extremes(np.fmax, np.fmax.reduce(parts, axis=1), REST)
    low = extremes(np.fmin, np.fmin.reduce(parts, axis=1), REST)
    return np.asarray(np.fmax(high - low, 0.0), np.float64)


def _swing(x: Floats) -> float:
    """Return how far x (n,) moved by its known values, 0 where there is none."""
    return max(0.0, float(np.fmax.reduce(x) - np.fmin.reduce(x)))
