"""The vehicle's clock: one time in microseconds since boot for every message, and where it breaks.

SERVO_OUTPUT_RAW.time_usec is 32 bits wide and wraps every 71.6 minutes while ATTITUDE.time_boot_ms
goes on, so the first is unwrapped beside the second. A stretch in which both channels flow on one
clock is a segment; a reboot, a step back or a long silence of either channel ends it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from yawid.blocks import Floats, Held, Ints, MessageBlock

BACK_STEP_US = 1_000_000
"""A channel's time may fall back less than this (a repeated or reordered message) without a new
segment."""
REBOOT_US = 5_000_000
"""A step back by more than this is called a reboot, by less a clock step."""
LEAP_US = 60_000_000
"""A clock that goes on by this much more than the receive stamps has leapt."""
SILENCE_US = 10_000_000
"""A channel silent for longer than this, while the clock goes on, ends the segment."""
UNIX_US = 10**15
"""MAVLink lets time_usec be since boot or Unix: this large it is Unix (the year 2001)."""
FIRST_WINDOW = 64
"""Rows looked at for the next break, doubled while there is none: a clock that breaks with every
message must not cost all that follows each time."""
OFFSET_WINDOW_US = 5_000_000
"""The offset to Unix time is sought in this much of each segment, then kept."""


def boot_us(fields: NDArray[Any]) -> Ints:
    """Return the boot time a message tells whole: time_boot_ms, or time_usec of 64 bits."""
    if "time_boot_ms" in (fields.dtype.names or ()):
        return fields["time_boot_ms"].astype(np.int64) * 1000
    return fields["time_usec"].astype(np.int64)


@dataclass(frozen=True, slots=True)
class Series:
    """Rows of one channel group in stream order: vehicle time ``t_us`` (n,), ``values`` (n, m)."""

    order: Ints
    received_us: Ints
    t_us: Ints
    values: Floats

    def __len__(self) -> int:
        return len(self.order)

    def select(self, rows: Ints | slice | np.ndarray[tuple[int], np.dtype[np.bool_]]) -> Series:
        """Return the rows chosen by a mask, an index array or a slice."""
        return Series(self.order[rows], self.received_us[rows], self.t_us[rows], self.values[rows])

    @staticmethod
    def concatenate(a: Series, b: Series) -> Series:
        """Return the rows of both, a first."""
        if len(a) == 0:
            return b
        return Series(
            np.concatenate([a.order, b.order]),
            np.concatenate([a.received_us, b.received_us]),
            np.concatenate([a.t_us, b.t_us]),
            np.concatenate([a.values, b.values]),
        )

    @staticmethod
    def empty(columns: int) -> Series:
        """Return a series without rows."""
        none = np.zeros(0, np.int64)
        return Series(none, none, none, np.zeros((0, columns)))


@dataclass(frozen=True, slots=True)
class Piece:
    """A stretch of one segment: its rows, and if it opens the segment, why the last one ended.

    ``epoch`` counts the meanings the surfaces have had, ``boot`` the vehicle's boots from 1.
    ``offset_us`` maps order to Unix minus boot time: the least seen so far in the segment's first
    seconds.
    """

    opens: bool
    why: Held
    epoch: int
    yaw: Series
    surface: Series
    offset_order: Ints
    offset_us: Ints
    boot: int = 1


def flow_together(yaw: Series, surface: Series) -> tuple[int, int] | None:
    """Return the message with which both channels flow, and the vehicle time in us from then on.

    None where one of them is empty.
    """
    if len(yaw) == 0 or len(surface) == 0:
        return None
    both = int(max(yaw.order[0], surface.order[0]))
    return both, max(int(series.t_us[series.order <= both].max()) for series in (yaw, surface))


def unwrap_uint32_us(raw: Ints, order: Ints, boot_us: Ints, boot_order: Ints) -> Ints:
    """Unwrap 32-bit microseconds beside the last full boot time heard before each of them.

    ``boot_us`` and ``boot_order`` (m >= 1,) are the full times. Returns int64 microseconds (n,);
    the result lies within 2**31 us (35.8 min) of the full time.
    """
    last = np.maximum(np.searchsorted(boot_order, order) - 1, 0)
    turns = np.rint((boot_us[last] - raw) / 2.0**32).astype(np.int64)
    unwrapped: Ints = raw + turns * 2**32
    return unwrapped


@dataclass(slots=True)
class OwnClock:
    """The clock of one message alone, where no other tells a full time: its newest readings.

    ``t_us`` (n,) is the time at ``order`` (n,) in microseconds: since boot where the message tells
    that, and since its first reading where it tells Unix time.
    """

    order: Ints = field(default_factory=lambda: np.zeros(0, np.int64))
    t_us: Ints = field(default_factory=lambda: np.zeros(0, np.int64))
    _shift: int | None = None
    _last: int | None = None

    def note(self, block: MessageBlock | None) -> None:
        """Take a block in; of what came before only the newest reading is still needed."""
        if block is None or len(block) == 0:
            self.order, self.t_us = self.order[-1:], self.t_us[-1:]
            return
        raw = boot_us(block.fields)
        if self._shift is None:
            self._shift = -int(raw[0]) if raw[0] >= UNIX_US else 0
        t_us = raw + self._shift
        if block.name == "SERVO_OUTPUT_RAW" and block.fields.dtype["time_usec"].itemsize == 4:
            # 32 bits: a fall by more than half of them is a wrap, a smaller one a reboot.
            steps = np.diff(raw, prepend=raw[0] if self._last is None else self._last)
            turns = -np.cumsum(np.rint(steps / 2.0**32).astype(np.int64))
            self._last, self._shift = int(raw[-1]), self._shift + int(turns[-1]) * 2**32
            t_us = t_us + turns * 2**32
        self.order = np.concatenate([self.order[-1:], block.order])
        self.t_us = np.concatenate([self.t_us[-1:], t_us])

    def at(self, order: Ints) -> Ints:
        """Return the newest reading at or before each place (n,), at least one being known."""
        rows = np.maximum(np.searchsorted(self.order, order, side="right") - 1, 0)
        newest: Ints = self.t_us[rows]
        return newest


@dataclass(slots=True)
class Segmenter:
    """Cuts two series in stream order into pieces of segments.

    ``newest`` and ``heard_us`` are each channel's newest vehicle time and receive stamp,
    ``leap_us`` the longest leap forward that the stamps did not make.
    """

    newest: list[int | None] = field(default_factory=lambda: [None, None])
    heard_us: list[int] = field(default_factory=lambda: [0, 0])
    began_us: int | None = None
    offset_us: int | None = None
    reboots: int = 0
    clock_steps: int = 0
    leap_us: int = 0
    silences: int = 0
    epoch: int = 0
    _why: Held = Held.NONE

    def feed(self, yaw: Series, surface: Series) -> Iterator[Piece]:
        """Yield the pieces of this stretch of the stream, in order."""
        kind = np.repeat([0, 1], [len(yaw), len(surface)])
        merged = Series.concatenate(
            Series(yaw.order, yaw.received_us, yaw.t_us, np.zeros((len(yaw), 0))),
            Series(surface.order, surface.received_us, surface.t_us, np.zeros((len(surface), 0))),
        )
        by_order = np.argsort(merged.order, kind="stable")
        merged, kind = merged.select(by_order), kind[by_order]
        row = np.where(by_order < len(yaw), by_order, by_order - len(yaw))
        start, window = 0, max(FIRST_WINDOW, len(kind))
        while start < len(kind):
            opens = self.newest == [None, None]
            near = slice(start, start + window)
            stop, good = self._until_break(merged.t_us[near], kind[near])
            rows, kinds = row[start : start + stop], kind[start : start + stop]
            offset_order, offset_us = self._offsets(merged.select(slice(start, start + stop)))
            yield Piece(
                opens,
                self._why if opens else Held.NONE,
                self.epoch,
                yaw.select(rows[good & (kinds == 0)]),
                surface.select(rows[good & (kinds == 1)]),
                offset_order,
                offset_us,
                self.reboots + 1,
            )
            received = merged.received_us[start : start + stop]
            for k in (0, 1):
                if len(own := received[kinds == k]):
                    self.heard_us[k] = int(own[-1])
            start += stop
            is_whole, window = stop == window, 2 * window
            if start < len(kind) and not is_whole:
                t_us, heard_us = int(merged.t_us[start]), int(merged.received_us[start])
                self._break(t_us, heard_us, int(kind[start]))
                window = FIRST_WINDOW

    def _until_break(
        self, t: Ints, kind: Ints
    ) -> tuple[int, np.ndarray[tuple[int], np.dtype[np.bool_]]]:
        """Return how many rows belong to this segment, and which of them go forward in time."""
        before = np.stack([_newest_before(t, kind == k, self.newest[k]) for k in (0, 1)])
        own = before[kind, np.arange(len(t))]
        other = before[1 - kind, np.arange(len(t))]
        never = np.iinfo(np.int64).min
        back = (own != never) & (t <= own - BACK_STEP_US)
        silent = (own != never) & (t - np.maximum(own, 0) > SILENCE_US)
        alone = (other != never) & (t - np.maximum(other, 0) > SILENCE_US)
        breaks = back | silent | alone
        stop = int(np.argmax(breaks)) if breaks.any() else len(t)
        good = (own[:stop] == never) | (t[:stop] > own[:stop])
        for k in (0, 1):
            mine = t[:stop][kind[:stop] == k]
            if len(mine):
                last = self.newest[k]
                self.newest[k] = int(max(mine.max(), mine[0] if last is None else last))
        return stop, good

    def _break(self, t: int, heard_us: int, kind: int) -> None:
        own = self.newest[kind]
        step = 0 if own is None else t - own
        leap = step - (heard_us - self.heard_us[kind])
        if step <= -REBOOT_US:
            self.reboots += 1
        elif step < 0:
            self.clock_steps += 1
        elif step > 0 and leap > LEAP_US:
            self.clock_steps += 1
            self.leap_us = max(self.leap_us, leap)
        else:
            self.silences += 1
        self._restart(Held.REBOOT if step < 0 else Held.GAP)

    def new_meaning(self) -> None:
        """Start a new segment because a unit of deflection no longer means what it did."""
        self.epoch += 1
        self._restart(Held.RUDDER_CHANGED)

    def _restart(self, why: Held) -> None:
        self._why = why
        self.newest = [None, None]
        self.began_us = self.offset_us = None

    def _offsets(self, rows: Series) -> tuple[Ints, Ints]:
        """Return the running minimum of received - boot over the segment's first seconds."""
        if len(rows) == 0:
            return rows.order, rows.t_us
        if self.began_us is None:
            self.began_us = int(rows.t_us[0])
        young = rows.t_us <= self.began_us + OFFSET_WINDOW_US
        latest = np.iinfo(np.int64).max if self.offset_us is None else self.offset_us
        lag = np.where(young, rows.received_us - rows.t_us, latest)
        lag[0] = min(lag[0], latest)
        offsets = np.minimum.accumulate(lag)
        self.offset_us = int(offsets[-1])
        return rows.order, offsets


def _newest_before(
    t: Ints, mine: np.ndarray[tuple[int], np.dtype[np.bool_]], carried: int | None
) -> Ints:
    """Return the newest time of one channel strictly before each row (int64 minimum: none)."""
    never = np.iinfo(np.int64).min
    seen = np.where(mine, t, never)
    first = never if carried is None else carried
    shifted = np.concatenate([[first], seen[:-1]])
    newest: Ints = np.maximum.accumulate(shifted)
    return newest
