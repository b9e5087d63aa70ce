"""The first five seconds: how fast the channels flow, and hence the rate of the grid.

Nothing is aligned before the rate is known, so the pieces received until then are kept and aligned
after. Live and replay take the same decision from the same messages. How fast each channel flowed
in all is counted beside it.
"""

import math
from dataclasses import dataclass, field, replace
from itertools import takewhile

import numpy as np

from yawid.blocks import Ints
from yawid.channels.series import Piece, Series, flow_together
from yawid.config.run import DEFAULT_RATE_HZ
from yawid.errors import ConfigError

WINDOW_US = 5_000_000
BRIDGED = 3.0
JITTER_US = 5_000.0
MOST_SEGMENTS = 1000
"""So many segments too short to report a rate are kept: a clock that leaps with every message must
not take memory without end."""
RATE_TOLERANCE = 1.05
"""An explicit rate may exceed the measured one by this factor: message intervals jitter."""
LONGEST_STEP_US = 2_000_000
"""Over a longer step nothing flowed: a gap, or a clock that leapt."""


@dataclass(slots=True)
class StartUp:
    """Collects pieces until both channels have flowed together for five seconds."""

    pieces: list[Piece] = field(default_factory=list)
    intervals_us: tuple[float, float] | None = None
    _first: int = 0
    _opened: list[int] = field(default_factory=list)

    def feed(self, piece: Piece) -> bool:
        """Take a piece; return whether the window is complete."""
        if piece.opens:
            self._opened.append(len(self.pieces))
            self._drop_the_oldest()
            self._first = len(self.pieces)
        self.pieces.append(piece)
        yaw, surface = self._segment()
        together = flow_together(yaw, surface)
        if together is None:
            self._forget(yaw, surface)
            return False
        _, begin = together
        ends = [s.order[s.t_us >= begin + WINDOW_US] for s in (yaw, surface)]
        if not any(len(end) for end in ends):
            return False
        last = min(int(end[0]) for end in ends if len(end))
        self.intervals_us = _medians(yaw, surface, begin, last)
        return self.intervals_us is not None

    def _forget(self, yaw: Series, surface: Series) -> None:
        """Keep the newest row: while one channel is silent, no older one can reach a sample."""
        opened, newest = self.pieces[self._first], self.pieces[-1]
        last = slice(-1, None)
        kept = replace(
            opened,
            yaw=yaw.select(last),
            surface=surface.select(last),
            offset=newest.offset.select(last),
        )
        self.pieces[self._first :] = [kept]

    def _drop_the_oldest(self) -> None:
        if len(self._opened) > MOST_SEGMENTS:
            cut = self._opened[1]
            del self.pieces[:cut]
            self._opened = [place - cut for place in self._opened[1:]]

    def give_up(self) -> bool:
        """Take what there is at the end of the stream; return whether it gives a rate at all."""
        starts = [i for i, piece in enumerate(self.pieces) if piece.opens]
        for self._first in starts:
            yaw, surface = self._segment()
            if len(yaw) and len(surface):
                begin = max(int(yaw.t_us[0]), int(surface.t_us[0]))
                last = max(int(yaw.order[-1]), int(surface.order[-1]))
                self.intervals_us = self.intervals_us or _medians(yaw, surface, begin, last)
        return self.intervals_us is not None

    def _segment(self) -> tuple[Series, Series]:
        """Return the rows of the segment now open."""
        opened, *later = self.pieces[self._first :]
        own = [opened, *takewhile(lambda piece: not piece.opens, later)]
        return Series.joined([p.yaw for p in own]), Series.joined([p.surface for p in own])


def _medians(yaw: Series, surface: Series, begin: int, last: int) -> tuple[float, float] | None:
    """Return the median message intervals (yaw, surface) in microseconds, None where too few."""
    found = []
    for series in (yaw, surface):
        t = series.t_us[(series.t_us >= begin) & (series.order <= last)]
        if len(t) < 3:
            return None
        found.append(float(np.median(np.diff(t))))
    return found[0], found[1]


def sample_rate(asked_hz: float | None, intervals_us: tuple[float, float]) -> float:
    """Return the rate of the grid in Hz: as asked, or 20, or where that is lower the log's own.

    Raises:
        ConfigError: the rate asked for is above the log's own.
    """
    yaw_hz, surface_hz = (1e6 / interval for interval in intervals_us)
    # Three digits: the median of jittered stamps carries no more.
    own = float(f"{min(yaw_hz, surface_hz):.3g}")
    if asked_hz is None:
        return min(DEFAULT_RATE_HZ, own)
    if asked_hz > own * RATE_TOLERANCE:
        raise ConfigError(
            f"--rate {asked_hz:g} is above the rate of the messages (yaw {yaw_hz:.3g} Hz, rudder "
            f"{surface_hz:.3g} Hz): use --rate {own:g} or less"
        )
    return asked_hz


def bridged_gaps_us(sample_time_s: float, intervals_us: tuple[float, float]) -> tuple[float, float]:
    """Return the longest message intervals (yaw, surface) that are not a gap, in microseconds.

    Two messages lost in a row are bridged, or what happens within three samples; real links deliver
    10 Hz as 40, 100 and 270 ms.
    """
    yaw_us, surface_us = (
        BRIDGED * max(1e6 * sample_time_s, interval) + JITTER_US for interval in intervals_us
    )
    return yaw_us, surface_us


@dataclass(slots=True)
class Flow:
    """Counts one channel's steps from message to message on the vehicle's clock.

    A message that came twice, or late, is no step of its own.
    """

    steps: int = 0
    flowed_us: int = 0
    _newest_us: int | None = None

    def observe(self, t_us: Ints) -> None:
        """Take in the times (n,) of its rows."""
        if len(t_us) == 0:
            return
        before = np.append(t_us[:1] if self._newest_us is None else self._newest_us, t_us)
        steps = np.diff(before)
        flowing = (steps > 0) & (steps <= LONGEST_STEP_US)
        self.steps += int(flowing.sum())
        self.flowed_us += int(steps[flowing].sum())
        self._newest_us = int(t_us[-1])

    @property
    def rate_hz(self) -> float:
        """The mean rate while it flowed, NaN before there are two steps."""
        return 1e6 * self.steps / self.flowed_us if self.steps >= 2 else math.nan
