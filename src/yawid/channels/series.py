"""Messages become rows: yaw rate, yaw and roll from ATTITUDE, surfaces from the servo message."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from yawid.blocks import Floats, Ints, MessageBlock
from yawid.channels.clock import Series, unwrap_uint32_us
from yawid.channels.context import LEAST_AIRSPEED, Context
from yawid.channels.surface import Surface

ABSURD_RAD_S = 50.0
"""No aircraft turns at eight revolutions a second; such a value is a corrupted one."""
STEEPEST = np.deg2rad(80.0)
"""Beyond this pitch Euler's formula has no heading rate."""
_NONE = np.zeros(0, np.int64)


GRAVITY = 9.80665
RATE, YAW, ROLL, TURN, AIRSPEED, ON_GROUND, MODE = range(7)
"""The columns of a yaw row; those from AIRSPEED on are held from message to message."""


@dataclass(slots=True)
class YawReader:
    """ATTITUDE to the columns above; ``heading_rate`` makes the rate psi_dot by Euler's formula."""

    heading_rate: bool = False
    turns: int = 0
    _last_yaw: float | None = None

    def read(self, block: MessageBlock | None, context: Context) -> Series:
        """Return the rows of a block of ATTITUDE, NaN where a value is not finite or absurd."""
        if block is None:
            return Series.empty(MODE + 1)
        names = ("roll", "pitch", "yaw", "pitchspeed", "yawspeed")
        roll, pitch, yaw, q, r = (_sound(np.asarray(block.fields[n], float)) for n in names)
        rate = r
        if self.heading_rate:
            upright = np.where(np.abs(pitch) < STEEPEST, np.cos(pitch), np.nan)
            rate = (q * np.sin(roll) + r * np.cos(roll)) / upright
        held = context.at(block.order)
        speed = np.where(held[:, 0] > LEAST_AIRSPEED, held[:, 0], np.nan)
        turn = GRAVITY / speed * np.sin(roll) * np.cos(pitch)
        t_us = block.fields["time_boot_ms"].astype(np.int64) * 1000
        values = np.column_stack([rate, self._unwrap(yaw), roll, turn, held])
        return Series(block.order, block.received_us, t_us, values)

    def _unwrap(self, yaw: Floats) -> Floats:
        """Add whole turns, counted in integers so that the cut of the stream leaves no rounding."""
        rows = np.flatnonzero(np.isfinite(yaw))
        if len(rows) == 0:
            return yaw
        known = yaw[rows]
        before = known[0] if self._last_yaw is None else self._last_yaw
        steps = np.diff(known, prepend=before)
        turns = self.turns - np.cumsum(np.rint(steps / (2.0 * np.pi))).astype(np.int64)
        self.turns, self._last_yaw = int(turns[-1]), float(known[-1])
        unwrapped = yaw.copy()
        unwrapped[rows] = known + 2.0 * np.pi * turns
        return unwrapped


def _sound(values: Floats) -> Floats:
    return np.where(np.abs(values) < ABSURD_RAD_S, values, np.nan)


@dataclass(slots=True)
class SurfaceReader:
    """The servo message to rows of deflections, its time unwrapped beside the last boot time."""

    columns: int
    _boot: tuple[Ints, Ints] = (_NONE, _NONE)

    def note_clock(self, attitude: MessageBlock | None) -> None:
        """Remember the full boot times of a block of ATTITUDE and the newest before it."""
        if attitude is None:
            self._boot = (self._boot[0][-1:], self._boot[1][-1:])
            return
        order = np.concatenate([self._boot[0][-1:], attitude.order])
        t_us = attitude.fields["time_boot_ms"].astype(np.int64) * 1000
        self._boot = (order, np.concatenate([self._boot[1][-1:], t_us]))

    def read(self, messages: Mapping[str, MessageBlock], surfaces: tuple[Surface, ...]) -> Series:
        """Return one row per message with the deflection of every surface, (n, columns)."""
        none = Series.empty(self.columns)
        if not surfaces or surfaces[0].message not in messages or len(self._boot[0]) == 0:
            return none
        block = messages[surfaces[0].message]
        block = block.select(surfaces[0].rows(block) & (block.order >= self._boot[0][0]))
        if len(block) == 0:
            return none
        values = np.stack([surface.deflection(block) for surface in surfaces], axis=1)
        return Series(block.order, block.received_us, self._times(block), values)

    def _times(self, block: MessageBlock) -> Ints:
        if "time_boot_ms" in (block.fields.dtype.names or ()):
            return block.fields["time_boot_ms"].astype(np.int64) * 1000
        raw = block.fields["time_usec"]
        if raw.dtype.itemsize == 8:
            return raw.astype(np.int64)
        order, boot_us = self._boot
        return unwrap_uint32_us(raw.astype(np.int64), block.order, boot_us, order)
