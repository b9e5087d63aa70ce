"""The rate of the grid, from the message rates of the first five seconds.

Nothing is aligned before the rate is known, so the pieces received until then are kept and aligned
afterwards. Live and replay take the same decision from the same messages. The mean message rates of
the whole run are counted here too.
"""

import math
from collections import deque
from dataclasses import dataclass, field

import numpy as np

from yawid.blocks import Ints
from yawid.channels.series import END, NEWEST, Piece, flow_together
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
    """The segments kept, one piece each, until both channels have had messages for five seconds."""

    pieces: deque[Piece] = field(default_factory=lambda: deque(maxlen=MOST_SEGMENTS))
    intervals_us: tuple[float, float] | None = None

    def feed_piece(self, piece: Piece) -> bool:
        """Take a piece in; return whether the message rates are known now."""
        if not piece.opens:
            piece = Piece.joined([self.pieces.pop(), piece])
        together = flow_together(piece.yaw, piece.surface)
        if together is None:  # while one channel is silent, no sample needs an older row
            self.pieces.append(piece.select(NEWEST))
            return False
        self.pieces.append(piece)
        _, begin = together
        both = piece.yaw, piece.surface
        ends = [int(s.order[s.t_us >= begin + WINDOW_US].min(initial=END)) for s in both]
        if min(ends) < END:
            self.intervals_us = _medians(piece, begin, min(ends))
        return self.intervals_us is not None

    def give_up(self) -> bool:
        """Use what there is at the end of the stream; return whether it gives message rates."""
        for piece in self.pieces:
            if self.intervals_us is None and len(piece.yaw) and len(piece.surface):
                begin = max(int(piece.yaw.t_us[0]), int(piece.surface.t_us[0]))
                self.intervals_us = _medians(piece, begin, END)
        return self.intervals_us is not None


def _medians(piece: Piece, begin: int, last: int) -> tuple[float, float] | None:
    """Return the median message intervals (yaw, surface) in us, None with fewer than 3 messages."""
    found = []
    for series in (piece.yaw, piece.surface):
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
