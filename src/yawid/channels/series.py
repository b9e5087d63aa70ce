"""Values at places of the stream: rows on the vehicle's clock, readings, and newest values.

A place is the ``order`` of a message: the byte at which its record starts in the stream. The clock
is one time in microseconds since boot for every message: SERVO_OUTPUT_RAW.time_usec has 32 bits
and wraps every 71.6 minutes while ATTITUDE.time_boot_ms goes on, so the first is unwrapped with
the help of the second.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from yawid.blocks import Array, Columns, Floats, Held, Ints, MessageBlock

END = int(np.iinfo(np.int64).max)
"""A place behind every byte of a stream."""
NEWEST = slice(-1, None)
"""The newest row, all that is kept of an earlier series."""


@dataclass(frozen=True, slots=True)
class Series(Columns):
    """Rows of one group of channels in stream order: times ``t_us`` (n,) and ``values`` (n, m).

    ``t_us`` is vehicle time, ``received_us`` (n,) the receive stamp in us of Unix time.
    """

    order: Ints
    received_us: Ints
    t_us: Ints
    values: Floats

    @staticmethod
    def empty(columns: int) -> "Series":
        """Return a series without rows."""
        none = np.zeros(0, np.int64)
        return Series(none, none, none, np.zeros((0, columns)))


@dataclass(frozen=True, slots=True)
class Readings(Columns):
    """Readings of a clock in microseconds, ``us`` (n,), at places ``order`` (n,) of the stream."""

    order: Ints
    us: Ints

    @staticmethod
    def none() -> "Readings":
        """Return no readings."""
        return Readings(np.zeros(0, np.int64), np.zeros(0, np.int64))

    def at(self, order: Ints) -> Ints:
        """Return the newest reading (m,) at or before each place (m,), else the first reading."""
        rows = np.maximum(np.searchsorted(self.order, order, side="right") - 1, 0)
        return self.us[rows]


@dataclass(frozen=True, slots=True)
class Piece(Columns):
    """A stretch of one segment: its rows and, if it opens the segment, why the last one ended.

    ``epoch`` counts the changes of the surfaces' meaning, ``boot`` the vehicle's boots from 1.
    ``offset`` maps places to Unix time minus boot time in us, the least so far in the first seconds
    of the segment.
    """

    opens: bool
    why: Held
    epoch: int
    yaw: Series
    surface: Series
    offset: Readings
    boot: int = 1


def flow_together(yaw: Series, surface: Series) -> tuple[int, int] | None:
    """Return the place and the vehicle time in us from which both have rows, None without them."""
    if len(yaw) == 0 or len(surface) == 0:
        return None
    both = int(max(yaw.order[0], surface.order[0]))
    return both, max(int(series.t_us[series.order <= both].max()) for series in (yaw, surface))


@dataclass(slots=True)
class Latest:
    """The newest values (``columns``,) of a message before any place, NaN before the first one."""

    columns: int
    order: Ints = field(default_factory=lambda: np.full(1, -1, np.int64))
    values: Floats = field(init=False)

    def __post_init__(self) -> None:
        self.values = np.full((1, self.columns), np.nan)

    def observe(self, block: MessageBlock | None, read: Callable[[Array], Floats]) -> None:
        """Take a block in, if there is one: ``read`` makes values (n, columns) from fields (n,).

        Of the earlier rows only the newest is kept.
        """
        if block is not None:
            self.add(block.order, read(block.fields))

    def add(self, order: Ints, values: Floats) -> None:
        """Take in values (n, columns) at places ``order`` (n,), like :meth:`observe`."""
        self.order = np.concatenate([self.order[-1:], order])
        self.values = np.concatenate([self.values[-1:], values])

    def at(self, order: Ints) -> Floats:
        """Return the newest values (n, columns) before each place (n,)."""
        return self.values[np.searchsorted(self.order, order) - 1]


def boot_us(fields: Array) -> Ints:
    """Return the boot time in us (n,) that a message reports: time_boot_ms, or time_usec (n,)."""
    if "time_boot_ms" in (fields.dtype.names or ()):
        return fields["time_boot_ms"].astype(np.int64) * 1000
    return fields["time_usec"].astype(np.int64)


def unwrap_uint32_us(raw: Ints, order: Ints, boot_us: Ints, boot_order: Ints) -> Ints:
    """Return 32-bit microseconds unwrapped by the last full boot time received before each of them.

    ``boot_us`` and ``boot_order`` (m >= 1,) are the full times and their places. The result, int64
    microseconds (n,), lies within 2**31 us (35.8 min) of the full time.
    """
    last = np.maximum(np.searchsorted(boot_order, order) - 1, 0)
    turns = np.rint((boot_us[last] - raw) / 2.0**32).astype(np.int64)
    return raw + turns * 2**32
