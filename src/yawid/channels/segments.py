"""Segments of a stream: within one, both channels are on one clock that does not break.

A reboot, a step back or a long silence of either channel ends a segment. Each of the vehicle's
boots has a clock of its own, and --from and --to are times of that clock.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from yawid.blocks import Bools, Held, Ints
from yawid.channels.series import Piece, Readings, Series
from yawid.config.run import RunConfig
from yawid.errors import ConfigError

BACK_STEP_US = 1_000_000
"""A step back of a channel's time by less than this (a repeated or reordered message) begins no new
segment."""
REBOOT_US = 5_000_000
"""A step back by this much or more is called a reboot, by less a clock step."""
LEAP_US = 60_000_000
"""A clock that advances by this much more than the receive stamps has leapt."""
SILENCE_US = 10_000_000
"""A channel that is silent for longer than this, while the clock goes on, ends the segment."""
FIRST_WINDOW = 64
"""The rows searched for the next break at first, doubled while there is none: otherwise a clock
that breaks at every message would cost a search of all rows each time."""
OFFSET_WINDOW_US = 5_000_000
"""The time at the beginning of each segment in which the offset to Unix time is determined."""
NEVER = np.iinfo(np.int64).min
"""A time before any."""
MOST_BOOTS = 1000
"""The most boots that are remembered: a clock that falls back at every message must not fill the
memory."""


@dataclass(slots=True)
class Segmenter:
    """The division of two series, in stream order, into pieces of segments.

    ``newest`` and ``received_us`` are each channel's newest vehicle time and receive stamp in us;
    ``leap_us`` is the longest leap forward that the receive stamps did not make. ``reboots``,
    ``clock_steps`` and ``silences`` count the breaks, ``epoch`` the changes of meaning.
    """

    newest: list[int] = field(default_factory=lambda: [NEVER, NEVER])
    received_us: list[int] = field(default_factory=lambda: [0, 0])
    began_us: int | None = None
    offset_us: int | None = None
    reboots: int = 0
    clock_steps: int = 0
    leap_us: int = 0
    silences: int = 0
    epoch: int = 0
    _why: Held = Held.NONE

    def feed_series(self, yaw: Series, surface: Series) -> Iterator[Piece]:
        """Yield the pieces of this stretch of the stream, in order."""
        kind, both = np.repeat([0, 1], [len(yaw), len(surface)]), (yaw, surface)
        bare = [Series(s.order, s.received_us, s.t_us, s.values[:, :0]) for s in both]
        merged = Series.joined(bare)
        by_order = np.argsort(merged.order, kind="stable")
        merged, kind = merged.select(by_order), kind[by_order]
        row = np.where(by_order < len(yaw), by_order, by_order - len(yaw))
        start, window = 0, max(FIRST_WINDOW, len(kind))
        while start < len(kind):
            opens = self.newest == [NEVER, NEVER]
            near = slice(start, start + window)
            stop, good = self._until_break(merged.t_us[near], kind[near])
            rows, kinds = row[start : start + stop], kind[start : start + stop]
            why = self._why if opens else Held.NONE
            yaws, surfaces = (s.select(rows[good & (kinds == k)]) for k, s in enumerate(both))
            offsets = self._offsets(merged.select(slice(start, start + stop)))
            yield Piece(opens, why, self.epoch, yaws, surfaces, offsets, self.reboots + 1)
            received = merged.received_us[start : start + stop]
            for k in (0, 1):
                if len(own := received[kinds == k]):
                    self.received_us[k] = int(own[-1])
            start += stop
            is_whole, window = stop == window, 2 * window
            if start < len(kind) and not is_whole:
                t_us, received_us = int(merged.t_us[start]), int(merged.received_us[start])
                self._break(t_us, received_us, int(kind[start]))
                window = FIRST_WINDOW

    def _until_break(self, t: Ints, kind: Ints) -> tuple[int, Bools]:
        """Return how many rows belong to this segment, and which of them advance in time."""
        before = np.stack([_newest_before(t, kind == k, self.newest[k]) for k in (0, 1)])
        own = before[kind, np.arange(len(t))]
        other = before[1 - kind, np.arange(len(t))]
        back = (own != NEVER) & (t <= own - BACK_STEP_US)
        silent = (own != NEVER) & (t - np.maximum(own, 0) > SILENCE_US)
        alone = (other != NEVER) & (t - np.maximum(other, 0) > SILENCE_US)
        breaks = back | silent | alone
        stop = int(np.argmax(breaks)) if breaks.any() else len(t)
        good = (own[:stop] == NEVER) | (t[:stop] > own[:stop])
        for k in (0, 1):
            self.newest[k] = int(t[:stop][kind[:stop] == k].max(initial=self.newest[k]))
        return stop, good

    def _break(self, t: int, received_us: int, kind: int) -> None:
        step = 0 if self.newest[kind] == NEVER else t - self.newest[kind]
        leap = step - (received_us - self.received_us[kind])
        has_leapt = step > 0 and leap > LEAP_US
        self.leap_us = max(self.leap_us, leap) if has_leapt else self.leap_us
        self.reboots += step <= -REBOOT_US
        self.clock_steps += -REBOOT_US < step < 0 or has_leapt
        self.silences += step >= 0 and not has_leapt
        self.begin_segment(Held.REBOOT if step < 0 else Held.GAP)

    def begin_segment(self, why: Held = Held.RUDDER_CHANGED) -> None:
        """Start a new segment; where the rudder changes, its unit has another meaning there."""
        self.epoch += bool(why & Held.RUDDER_CHANGED)
        self._why, self.newest = why, [NEVER, NEVER]
        self.began_us = self.offset_us = None

    def _offsets(self, rows: Series) -> Readings:
        """Return the least receive stamp minus boot time so far, in the segment's first seconds."""
        if len(rows) == 0:
            return Readings(rows.order, rows.t_us)
        if self.began_us is None:
            self.began_us = int(rows.t_us[0])
        young = rows.t_us <= self.began_us + OFFSET_WINDOW_US
        latest = np.iinfo(np.int64).max if self.offset_us is None else self.offset_us
        lag = np.where(young, rows.received_us - rows.t_us, latest)
        lag[0] = min(lag[0], latest)
        offsets = np.minimum.accumulate(lag)
        self.offset_us = int(offsets[-1])
        return Readings(rows.order, offsets)


def _newest_before(t: Ints, mine: Bools, carried: int) -> Ints:
    """Return the newest time of one channel strictly before each row, ``NEVER`` without any."""
    return np.maximum.accumulate(np.append(carried, np.where(mine, t, NEVER)))[:-1]


def outside(config: RunConfig, what: str) -> ConfigError:
    """Return the error that --from and --to lie outside ``what``, a text of what it covers."""
    ends = (("from", config.from_s), ("to", config.to_s))
    given = " ".join(f"--{name} {value:g}" for name, value in ends if value is not None)
    return ConfigError(f"{given} is outside {what} since boot")


@dataclass(slots=True)
class Boots:
    """The first and the last time (us since boot) of a yaw message, by the boot's number from 1.

    Boots without a yaw message are left out.
    """

    spans_us: dict[int, tuple[int, int]] = field(default_factory=dict)

    def observe(self, boot: int, yaw: Series) -> None:
        """Take in rows of yaw from one boot."""
        if len(yaw) == 0 or (len(self.spans_us) >= MOST_BOOTS and boot not in self.spans_us):
            return
        first, last = self.spans_us.get(boot, (int(yaw.t_us[0]), int(yaw.t_us[0])))
        self.spans_us[boot] = min(first, int(yaw.t_us.min())), max(last, int(yaw.t_us.max()))

    @property
    def text(self) -> str:
        """The times that the log covers, in words."""
        spans = {n: f"{a / 1e6:.1f} to {b / 1e6:.1f} s" for n, (a, b) in self.spans_us.items()}
        if len(spans) == 1:
            return next(iter(spans.values()))
        return ", ".join(f"boot {number} from {span}" for number, span in spans.items())

    def check(self, config: RunConfig) -> None:
        """Check that the log contains some of what --boot, --from and --to ask for.

        Raises:
            ConfigError: it contains nothing of it.
        """
        if not self.spans_us:
            return
        if config.boot is not None and config.boot not in self.spans_us:
            count = len(self.spans_us)
            raise ConfigError(
                f"--boot {config.boot} is not in the log, which holds {count} "
                f"{'boot' if count == 1 else 'boots'}: {self.text} since boot"
            )
        asked = [self.spans_us[n] for n in self.spans_us if config.boot in (None, n)]
        low, high = config.window_us
        if not any(low <= last and first <= high for first, last in asked):
            raise outside(config, f"the log, which covers {self.text}")

    def warning(self, config: RunConfig) -> str | None:
        """Return a warning if --from and --to cut several boots alike, else None."""
        is_cut = config.from_s is not None or config.to_s is not None
        if config.boot is not None or len(self.spans_us) < 2 or not is_cut:
            return None
        return (
            f"the log holds {len(self.spans_us)} boots, and --from and --to apply to each of them: "
            f"{self.text}; choose one by --boot"
        )
