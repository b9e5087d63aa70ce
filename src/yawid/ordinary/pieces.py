"""The stream of an ordinary flight: samples and motion in, sums of spectra by airspeed kept.

The flight is judged in pieces of 20 s of the vehicle's clock. A piece is ordinary where

- every sample is used, so that the aircraft flies, and none is further than .5 s from the next;
- its airspeed is known, and within 6 % of the pieces' before it;
- the rudder rests, or what the aileron does not explain of it is small.

Six such pieces in a row are a window of 120 s, and the last three of them begin the next one. The
rest of a row is a window, too, if it has 40 s. Where a stream was cut into blocks changes nothing.
What is kept is bounded: of each airspeed, to 3 %, at most eight sums, each of the same time.
"""

import math
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise

import numpy as np

from yawid.blocks import MotionBlock, SampleBlock
from yawid.lateral.motion import Motion
from yawid.manoeuvre.motion_store import MotionStore, true_airspeed
from yawid.ordinary.spectra import Sums, window_sums
from yawid.results.excitation import own_part

PIECE_S = 20.0
"""The length of a piece in s: what one movement of the rudder costs an ordinary flight."""
PIECES, KEPT = 6, 3
"""The pieces of a window, and those that are in the next one, too. In windows of 60 s the ends leak
into the mode of an airliner: a 737's wn came out 11 % high."""
LEAST_PIECES = 2
SETTLED_US = 1_000_000
"""A piece is judged this long after its end, when all its messages have come."""
SAME_SPEED = 0.06
"""The largest difference of airspeeds in a window, and the width of two bins: wn follows them."""
BINS = 4
BIN = math.log(1.0 + SAME_SPEED / 2.0)
LONGEST_GAP_US = 500_000
LEAST_USED = 0.97
AT_REST = 2e-3
"""The standard deviation of a rudder at rest, in half travels: that of whole us of PWM is .0006."""
OWN_PART = 0.05
"""The part of the rudder's variance that the aileron may leave: a damper's is .6 and more."""
BANKED, MEAN_S = 0.14, 2.0
"""The bank in rad of a turn, as a mean over so many s: gusts have less."""
MOST_SUMS = 8


class Kept:
    """The sums of one airspeed, in the order of time, each of as many windows."""

    def __init__(self) -> None:
        self._each = 1
        self.sums: list[Sums] = []

    def add(self, sums: Sums) -> None:
        """Add the sums of a window."""
        if self.sums and self.sums[-1].windows < self._each:
            self.sums[-1] = self.sums[-1] + sums
            return
        if len(self.sums) == MOST_SUMS:
            self.sums = [a + b for a, b in zip(self.sums[::2], self.sums[1::2], strict=True)]
            self._each *= 2
        self.sums.append(sums)


class Ordinary:
    """An ordinary flight: ``move`` motion and ``feed`` samples, then ``finish``.

    ``travel_unit`` is half the rudder's travel in the unit of ``u``. ``by_speed`` has the sums by
    airspeed, ``lost_s`` the time in s that was left out by its cause, and ``seen_s`` all of it.
    """

    def __init__(self, travel_unit: float = 1.0) -> None:
        self._unit = travel_unit
        self._store = MotionStore(PIECES * PIECE_S)
        self._waiting: list[SampleBlock] = []
        self._row: list[SampleBlock] = []
        self._new = 0
        self._banked = False
        self._turns = 0
        self.by_speed: dict[int, Kept] = {}
        self.lost_s: dict[str, float] = {}
        self.seen_s = 0.0
        self.step_s = math.nan

    def move(self, motion: MotionBlock) -> None:
        """Take motion in, before the samples of the same time."""
        self._store.feed(motion)

    def feed(self, samples: SampleBlock) -> None:
        """Take samples in."""
        self._waiting.append(samples)
        number = self._waiting[0].boot_us[0] // _PIECE_US
        if samples.boot_us[-1] // _PIECE_US == number:
            return
        pieces = list(_pieces(SampleBlock.joined(self._waiting)))
        settled = int(pieces[-1].boot_us[-1]) % _PIECE_US >= SETTLED_US
        done = len(pieces) - 1 if settled else len(pieces) - 2
        for piece in pieces[: max(done, 0)]:
            self._judge(piece)
        self._waiting = pieces[max(done, 0) :]
        self._store.forget(samples)

    def finish(self) -> None:
        """End the stream: what is not a whole piece is left out."""
        for piece in _pieces(SampleBlock.joined(self._waiting)) if self._waiting else ():
            self._judge(piece)
        self._waiting = []
        self._close()

    def halves(self) -> tuple[list[Sums], list[Sums]]:
        """Return the sums of the neighbouring airspeeds flown longest: first and second halves.

        Each airspeed is halved by itself, so that both halves have the same airspeeds.
        """
        seconds = {i: sum(x.seconds for x in kept.sums) for i, kept in self.by_speed.items()}
        runs = [range(i, i + BINS) for i in sorted(seconds)]
        best = max(runs, key=lambda at: sum(seconds.get(i, 0.0) for i in at), default=range(0))
        first: list[Sums] = []
        second: list[Sums] = []
        for i in best:
            until = 0.0
            for each in self.by_speed[i].sums if i in seconds else ():
                (first if until + each.seconds / 2.0 <= seconds[i] / 2.0 else second).append(each)
                until += each.seconds
        return first, second

    def _judge(self, piece: SampleBlock) -> None:
        """Add a piece to the row, or end the row before it."""
        seconds = len(piece) * piece.sample_time_s
        self.seen_s, self.step_s = self.seen_s + seconds, piece.sample_time_s
        last = self._row[-1] if self._row else None
        follows = last is not None and (
            0 < int(piece.boot_us[0]) - int(last.boot_us[-1]) <= LONGEST_GAP_US
            and last.epoch[-1] == piece.epoch[0]
        )
        if not follows:
            self._close()
        cause = self._why_not(piece)
        if cause is not None:
            self.lost_s[cause] = self.lost_s.get(cause, 0.0) + seconds
            self._close()
            return
        if self._row:
            speed, before = true_airspeed(piece), true_airspeed(SampleBlock.joined(self._row))
            if abs(speed - before) > SAME_SPEED * before:
                self._close()
        self._row.append(piece)
        self._new += 1
        self._turns += self._turns_in(piece)
        if len(self._row) == PIECES:
            self._transform()
            self._row = self._row[-KEPT:]

    def _why_not(self, piece: SampleBlock) -> str | None:
        """Return why a piece is not ordinary, None where it is."""
        used = piece.select(piece.held == 0)
        expected = PIECE_S / piece.sample_time_s
        if len(used) < LEAST_USED * expected or (np.diff(used.boot_us) > LONGEST_GAP_US).any():
            return "not in flight, or with gaps"
        if not math.isfinite(true_airspeed(piece)):
            return "without an airspeed"
        rows = SampleBlock.joined([*self._row[-1:], piece])
        own = own_part(
            rows.u[:, 0] / self._unit, rows.aileron, np.zeros(len(rows)), piece.sample_time_s
        )
        rudder = (rows.u[:, 0] / self._unit)[np.isfinite(own)]
        own = own[np.isfinite(own)]
        if not len(own):
            return "without an aileron"
        if rudder.std() > AT_REST and own.std() > max(AT_REST, math.sqrt(OWN_PART) * rudder.std()):
            return "with a rudder that moves by itself"
        return None

    def _turns_in(self, piece: SampleBlock) -> int:
        """Return how many turns begin in a piece."""
        each = max(1, round(MEAN_S / piece.sample_time_s))
        roll = piece.roll[: len(piece) // each * each].reshape(-1, each)
        begun = 0
        for bank in np.abs(np.nanmean(roll, axis=1)).tolist():
            begun += bank > BANKED and not self._banked
            self._banked = bank > BANKED or (self._banked and bank > 0.5 * BANKED)
        return begun

    def _close(self) -> None:
        """End the row."""
        if self._new and len(self._row) >= LEAST_PIECES:
            self._transform()
        elif self._new:
            lost = self._new * PIECE_S
            self.lost_s["in rows shorter than 40 s"] = (
                self.lost_s.get("in rows shorter than 40 s", 0.0) + lost
            )
        self._row, self._new, self._turns, self._banked = [], 0, 0, False

    def _transform(self) -> None:
        """Add the window of the row to the sums of its airspeed."""
        motion = self._store.cut(SampleBlock.joined(self._row))
        new_s, turns = self._new * PIECE_S, self._turns
        self._new = self._turns = 0
        whole = motion if isinstance(motion, str) else _filled(motion)
        if isinstance(whole, str):
            self.lost_s[whole] = self.lost_s.get(whole, 0.0) + new_s
            return
        k = np.arange(len(whole.p)) * whole.sample_time_s
        aileron = np.interp(k, whole.command_times_s(), whole.aileron)
        sums = window_sums(whole, aileron, new_s, turns)
        at = math.floor(math.log(whole.airspeed_m_s) / BIN)
        self.by_speed.setdefault(at, Kept()).add(sums)


_PIECE_US = round(1e6 * PIECE_S)


def _pieces(samples: SampleBlock) -> Iterator[SampleBlock]:
    """Yield the samples of each 20 s of the clock; a clock that steps back begins another piece."""
    number = samples.boot_us // _PIECE_US
    edges = [
        0,
        *(np.flatnonzero((np.diff(number) != 0) | (np.diff(samples.k) < 0)) + 1).tolist(),
        len(samples),
    ]
    yield from (samples.select(slice(a, b)) for a, b in pairwise(edges))


def _filled(motion: Motion) -> Motion | str:
    """Return motion with its short gaps on lines, or in words why that cannot be."""
    if not motion.aileron_known:
        return "without an aileron"
    missing = np.isnan(motion.p + motion.r + motion.roll + motion.pitch + motion.q)
    if not missing.any():
        return motion
    edges = np.flatnonzero(np.diff(missing.astype(int), prepend=0, append=0)).reshape(-1, 2)
    if (
        missing.mean() > 1.0 - LEAST_USED
        or np.diff(edges).max() * motion.sample_time_s * 1e6 > LONGEST_GAP_US
    ):
        return "with gaps in the attitude"
    at, known = np.arange(len(missing)), np.flatnonzero(~missing)
    names = ("p", "r", "roll", "pitch", "q")
    return replace(motion, **{x: np.interp(at, known, getattr(motion, x)[known]) for x in names})
