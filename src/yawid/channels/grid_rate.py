"""The rate of the grid, from the message rates of the first five seconds.

Nothing is aligned before the rate is known, so the pieces received until then are kept and aligned
afterwards. Live and replay take the same decision from the same messages. The mean message rates of
the whole run are counted here too.
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
"""The time that both channels need for the message rates."""
BRIDGED = 3.0
"""The longest bridged interval, in message intervals or samples, whichever is longer."""
JITTER_US = 5_000.0
"""The jitter that is added to it."""
MOST_SEGMENTS = 1000
"""The most segments kept that are too short for a rate: a clock that leaps at every message must
not fill the memory."""
RATE_TOLERANCE = 1.05
"""The factor by which a given rate may exceed the measured one, since message intervals jitter."""
LONGEST_STEP_US = 2_000_000
"""A longer step counts as a gap or as a leap of the clock, not as an interval."""


@dataclass(slots=True)
class StartUp:
    """The pieces kept until both channels have had messages together for five seconds."""

    pieces: list[Piece] = field(default_factory=list)
    intervals_us: tuple[float, float] | None = None
    _first: int = 0
    _opened: list[int] = field(default_factory=list)

    def feed_piece(self, piece: Piece) -> bool:
        """Take a piece in; return whether the message rates are known now."""
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
        """Keep only the newest row: while one channel is silent, no sample needs an older one."""
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
        """Use what there is at the end of the stream; return whether it gives message rates."""
        starts = [i for i, piece in enumerate(self.pieces) if piece.opens]
        for self._first in starts:
            yaw, surface = self._segment()
            if len(yaw) and len(surface):
                begin = max(int(yaw.t_us[0]), int(surface.t_us[0]))
                last = max(int(yaw.order[-1]), int(surface.order[-1]))
                self.intervals_us = self.intervals_us or _medians(yaw, surface, begin, last)
        return self.intervals_us is not None

    def _segment(self) -> tuple[Series, Series]:
        """Return the rows of the segment that begins with piece ``_first``."""
        opened, *later = self.pieces[self._first :]
        own = [opened, *takewhile(lambda piece: not piece.opens, later)]
        return Series.joined([p.yaw for p in own]), Series.joined([p.surface for p in own])


def _medians(yaw: Series, surface: Series, begin: int, last: int) -> tuple[float, float] | None:
    """Return the median message intervals (yaw, surface) in us, None with fewer than 3 messages."""
    found = []
    for series in (yaw, surface):
        t = series.t_us[(series.t_us >= begin) & (series.order <= last)]
        if len(t) < 3:
            return None
        found.append(float(np.median(np.diff(t))))
    return found[0], found[1]


def sample_rate(asked_hz: float | None, intervals_us: tuple[float, float]) -> float:
    """Return the rate of the grid in Hz: the rate asked for, else 20 Hz or the log's own if lower.

    The log's own rate is that of its slower channel.

    Raises:
        ConfigError: the rate asked for is above the log's own.
    """
    yaw_hz, surface_hz = (1e6 / interval for interval in intervals_us)
    # The median of stamps with jitter is good for three digits only.
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

    Two messages lost in a row are bridged, and always three samples: real links deliver 10 Hz at
    intervals of 40, 100 and 270 ms.
    """
    yaw_us, surface_us = (
        BRIDGED * max(1e6 * sample_time_s, interval) + JITTER_US for interval in intervals_us
    )
    return yaw_us, surface_us


@dataclass(slots=True)
class Flow:
    """The count of one channel's steps from message to message on the vehicle's clock.

    A message that came twice, or too late, makes no step.
    """

    steps: int = 0
    flowed_us: int = 0
    _newest_us: int | None = None

    def observe(self, t_us: Ints) -> None:
        """Take in the times (n,) in us of the channel's rows."""
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
        """The mean rate in Hz without gaps, NaN before there are two steps."""
        return 1e6 * self.steps / self.flowed_us if self.steps >= 2 else math.nan
