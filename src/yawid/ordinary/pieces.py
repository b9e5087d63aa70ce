"""The stream of an ordinary flight: samples and motion in, sums of spectra by airspeed kept.

The flight is judged in pieces of 20 s of the vehicle's clock. A piece is ordinary where

- the aircraft flies: nearly every sample is used, and none is further than .5 s from the next;
- its airspeed is known, and within 6 % of that of the piece before it;
- the rudder rests, or is the aileron times a factor, but for a small part.

Six such pieces in a row are a window of 120 s, and the last three of them begin the next one. The
rest of a row is a window, too, if it has 40 s. Where a stream was cut into blocks changes nothing.
What is kept is bounded: the sums of each airspeed, to 3 %, and those of the last windows.
"""

import math
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise

import numpy as np

from yawid.blocks import SampleBlock
from yawid.lateral.motion_store import MotionStore
from yawid.ordinary.spectra import NONE, Sums, window_sums

PIECE_S = 20.0
"""The length of a piece in s: what one movement of the rudder costs an ordinary flight."""
PIECES, KEPT, LEAST_PIECES = 6, 3, 2
"""The pieces of a window, those that are in the next one, too, and those of the shortest. In
windows of 60 s the ends leak into an airliner's mode: a 737's wn came out 11 % high."""
SETTLED_US = 1_000_000
"""A piece is judged this long after its end, when its last messages have come."""
SAME_SPEED, BINS = 0.06, 4
"""The largest difference of airspeeds in a window, and the bins of half as much that answer
together: with two of them a light aircraft in gusts had 380 of its 900 s."""
LONGEST_GAP_US, LEAST_USED = 500_000, 0.97
"""The longest gap, which is filled by lines, and the least part of a piece that is there."""
AT_REST = 1e-3
"""The standard deviation of a rudder at rest, in half travels: that of whole us of PWM is .0006 to
.0008 with an aileron's part. With .002 a damper on a small aircraft in calm air, of .0012 and more,
passed for none: zeta .34 for .14."""
OWN_PART = 0.01
"""The part of the rudder's variance that the aileron may leave at the same instant: what is mixed
leaves less than AT_REST in all of 18 tuning flights, a damper .025 at the least, in 24 (seed 1702).
With lags, the aileron of a calm flight explains a damper too, as it explains r."""
BANKED, MEAN_S = 0.14, 2.0
"""The bank in rad of a turn, as a mean over so many s: gusts have less."""
RECENT = 15
"""The windows of ``recent``, a quarter of an hour: three times the least that an answer needs."""
_PIECE_US = round(1e6 * PIECE_S)


class Ordinary:
    """An ordinary flight: feed motion to its ``store``, then ``feed`` samples, and ``finish``.

    The motion comes before the samples of the same time.
    ``travel_unit`` is half the rudder's travel in the unit of ``u``. ``by_speed`` has the sums by
    airspeed, ``recent`` the last windows; ``lost_s`` has the time in s that was left out by
    its cause, and ``seen_s`` all of it. Another thread may read all of them meanwhile.
    """

    def __init__(self, travel_unit: float = 1.0) -> None:
        self._unit = travel_unit
        self.store = MotionStore(PIECES * PIECE_S)
        self._waiting: list[SampleBlock] = []
        self._row: list[SampleBlock] = []
        self._new = 0
        self.by_speed: dict[int, Sums] = {}
        self.recent: tuple[tuple[int, Sums], ...] = ()
        self.lost_s: defaultdict[str, float] = defaultdict(float)
        self.seen_s = 0.0

    def feed(self, samples: SampleBlock) -> None:
        """Take samples in."""
        self._waiting.append(samples)
        if samples.boot_us[-1] // _PIECE_US == self._waiting[0].boot_us[0] // _PIECE_US:
            return
        pieces = list(_pieces(SampleBlock.joined(self._waiting)))
        settled = int(pieces[-1].boot_us[-1]) % _PIECE_US >= SETTLED_US
        done = max(len(pieces) - (1 if settled else 2), 0)
        for piece in pieces[:done]:
            self._judge(piece)
        self._waiting = pieces[done:]
        self.store.forget(samples)

    def finish(self) -> None:
        """End the stream; what is not a whole piece is left out."""
        for piece in _pieces(SampleBlock.joined(self._waiting)) if self._waiting else ():
            self._judge(piece)
        self._end_row()

    def add(self, sums: Sums) -> int:
        """Add sums to those of their airspeed, and return the number of that."""
        at = math.floor(math.log(sums.speed / sums.seconds) / math.log(1.0 + SAME_SPEED / 2.0))
        self.by_speed[at] = self.by_speed.get(at, NONE) + sums
        return at

    def sums(self, *, recent: bool = False) -> Sums:
        """Return the sums of the neighbouring airspeeds that were flown longest."""
        at = self.recent if recent else sorted(self.by_speed.items())
        runs = (sum((x for j, x in at if i <= j < i + BINS), NONE) for i, _ in at)
        return max(runs, key=lambda x: x.seconds, default=NONE)

    def _judge(self, piece: SampleBlock) -> None:
        """Add a piece to the row, or end the row before it."""
        seconds = len(piece) * piece.sample_time_s
        self.seen_s += seconds
        cause = self._why_not(piece)
        if cause is not None or (self._row and not self._follows(piece)):
            self._end_row()
        if cause is not None:
            self.lost_s[cause] += seconds
            return
        self._row.append(piece)
        self._new += 1
        if len(self._row) == PIECES:
            self._transform()
            self._row = self._row[-KEPT:]

    def _follows(self, piece: SampleBlock) -> bool:
        """Return whether a piece goes on from the row, at its airspeed."""
        gap_us = int(piece.boot_us[0]) - int(self._row[-1].boot_us[-1])
        speed, before = (float(np.nanmean(x.airspeed)) for x in (piece, self._row[-1]))
        return (
            0 < gap_us <= LONGEST_GAP_US
            and piece.epoch[0] == self._row[-1].epoch[-1]
            and abs(speed - before) <= SAME_SPEED * before
        )

    def _why_not(self, piece: SampleBlock) -> str | None:
        """Return why a piece is not ordinary, None where it is."""
        used = piece.select(piece.held == 0)
        expected = PIECE_S / piece.sample_time_s
        if len(used) < LEAST_USED * expected or (np.diff(used.boot_us) > LONGEST_GAP_US).any():
            return "not in flight, or with gaps"
        if not np.isfinite(used.airspeed).all():
            return "without an airspeed"
        rows = SampleBlock.joined([*self._row[-1:], piece])
        u, aileron = rows.u[:, 0] / self._unit, rows.aileron
        known = np.isfinite(u) & np.isfinite(aileron)
        if not known.any():
            return "without an aileron"
        u, aileron = u[known] - u[known].mean(), aileron[known] - aileron[known].mean()
        own = u - aileron * (u @ aileron) / max(float(aileron @ aileron), 1e-12)
        moves = max(AT_REST, math.sqrt(OWN_PART) * float(u.std()))
        return "with a rudder that moves by itself" if own.std() > moves else None

    def _end_row(self) -> None:
        if self._new and len(self._row) >= LEAST_PIECES:
            self._transform()
        self.lost_s["in rows shorter than 40 s"] += self._new * PIECE_S
        self._row, self._new = [], 0

    def _transform(self) -> None:
        """Add the window of the row to the sums of its airspeed."""
        rows, new_s, self._new = SampleBlock.joined(self._row), self._new * PIECE_S, 0
        motion = self.store.cut(rows)
        if isinstance(motion, str):  # a record may begin before its first command
            motion = self.store.cut(rows.select(rows.boot_us >= rows.boot_us[0] + SETTLED_US))
        if isinstance(motion, str) or not motion.aileron_known:
            self.lost_s["without motion or aileron"] += new_s
            return
        k = np.arange(len(motion.p))
        aileron = np.interp(k * motion.sample_time_s, motion.command_times_s(), motion.aileron)
        for name in ("p", "r", "roll", "pitch", "q"):
            known = np.flatnonzero(np.isfinite(x := getattr(motion, name)))
            motion = replace(motion, **{name: np.interp(k, known, x[known])})
        each = round(MEAN_S / rows.sample_time_s)
        roll = rows.roll[-round(new_s / rows.sample_time_s) :]
        banks = np.abs(roll[: len(roll) // each * each].reshape(-1, each).mean(axis=1)) > BANKED
        turns = int(np.count_nonzero(np.diff(banks.astype(int), prepend=0) > 0))
        sums = window_sums(motion, aileron, new_s, turns)
        self.recent = (*self.recent, (self.add(sums), sums))[-RECENT:]


def _pieces(samples: SampleBlock) -> Iterator[SampleBlock]:
    """Yield the samples of each 20 s of the clock; a clock that steps back begins another piece."""
    begins = (np.diff(samples.boot_us // _PIECE_US) != 0) | (np.diff(samples.k) < 0)
    edges = [0, *(np.flatnonzero(begins) + 1).tolist(), len(samples)]
    yield from (samples.select(slice(a, b)) for a, b in pairwise(edges))
