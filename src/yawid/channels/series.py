"""Rows of one channel group on the vehicle's clock, and the stretches of a segment made of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from yawid.blocks import Columns, Floats, Held, Ints


@dataclass(frozen=True, slots=True)
class Series(Columns):
    """Rows of one channel group in stream order: vehicle time ``t_us`` (n,), ``values`` (n, m)."""

    order: Ints
    received_us: Ints
    t_us: Ints
    values: Floats

    @staticmethod
    def concatenate(a: Series, b: Series) -> Series:
        """Return the rows of both, a first."""
        return Series.joined([a, b]) if len(a) else b

    @staticmethod
    def empty(columns: int) -> Series:
        """Return a series without rows."""
        none = np.zeros(0, np.int64)
        return Series(none, none, none, np.zeros((0, columns)))


@dataclass(frozen=True, slots=True)
class Readings(Columns):
    """What was read off in microseconds, ``us`` (n,), at places ``order`` (n,) of the stream."""

    order: Ints
    us: Ints

    @staticmethod
    def none() -> Readings:
        """Return no readings."""
        return Readings(np.zeros(0, np.int64), np.zeros(0, np.int64))

    def at(self, order: Ints) -> Ints:
        """Return the newest reading (m,) at or before each place (m,), at least one being known."""
        rows = np.maximum(np.searchsorted(self.order, order, side="right") - 1, 0)
        newest: Ints = self.us[rows]
        return newest


@dataclass(frozen=True, slots=True)
class Piece:
    """A stretch of one segment: its rows, and if it opens the segment, why the last one ended.

    ``epoch`` counts the meanings the surfaces have had, ``boot`` the vehicle's boots from 1.
    ``offset`` maps order to Unix minus boot time: the least seen so far in the segment's first
    seconds.
    """

    opens: bool
    why: Held
    epoch: int
    yaw: Series
    surface: Series
    offset: Readings
    boot: int = 1


def flow_together(yaw: Series, surface: Series) -> tuple[int, int] | None:
    """Return the message with which both channels flow, and the vehicle time in us from then on.

    None where one of them is empty.
    """
    if len(yaw) == 0 or len(surface) == 0:
        return None
    both = int(max(yaw.order[0], surface.order[0]))
    return both, max(int(series.t_us[series.order <= both].max()) for series in (yaw, surface))
