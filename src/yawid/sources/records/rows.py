"""From a record's columns to rows of the channels: what each row has, and how long it holds."""

from dataclasses import replace
from itertools import pairwise
from typing import Any, Final

import numpy as np

from yawid.blocks import WINDOW_S, Bools, Floats, Held, Ints, RecordBlock
from yawid.quantities.table import CHANNELS
from yawid.sources.logs.as_mavlink import between

GONE_S: Final = 2.0
"""The longest silence over which values are interpolated."""
BACK_US: Final = 1_000_000
"""A time that falls back by so much starts again, as a clock does at boot."""
BRIDGED, JITTER_US = 3.0, 5_000
"""A row holds until the next one, unless more than two rows are lost between them."""
MARKS: Final = int(Held.GAP | Held.REBOOT)
"""The reasons in a run's export for rows that only mark a break: they were no samples."""
STRETCH_S: Final = 1.0
"""The length of the stretches by which the largest stroke is found."""
SLOW, FAST_PCT = 0.5, 90.0
"""Below this part of this percentile of its speeds, an aircraft does not fly."""


def same(value: float, count: int) -> Any:
    """Return an array of one value that takes no memory."""
    return np.broadcast_to(value, count)


class Rows:
    """The rows that the channels get, made a piece at a time from those (n,) of the file.

    If the file has no ``held``, each channel has rows of its own: the yaw's rows are those with a
    yaw rate, the surfaces' rows those with a rudder. At these rows angles are interpolated, and all
    other values are the last known ones. A run's export has ``held``, and its rows are complete.
    """

    def __init__(self, block: RecordBlock) -> None:
        block = block if (block.held >= 0).any() else _filled(block)
        changed = (block.held > 0) & (block.held & int(Held.RUDDER_CHANGED) != 0)
        marks = (block.held > 0) & (block.held & MARKS != 0)
        # A later break shows by the times.
        changed[0] |= marks[0]
        marks[0] = False
        is_held = (block.held > 0) & ~marks & ~changed
        has_yaw = np.isfinite(block.r) & ~changed | is_held
        has_surfaces = np.isfinite(block.rudder) & ~changed | is_held
        kept = ~marks & (has_yaw | has_surfaces | changed)
        block = replace(block, has_yaw=has_yaw, has_surfaces=has_surfaces)
        self.block = block.select(kept)
        self._ended, self._interval_us = _ended(self.block)

    def __len__(self) -> int:
        """Return the number of the file's rows that are kept, without the rows that are added."""
        return len(self.block)

    def piece(self, low: int, high: int) -> RecordBlock:
        """Return the rows from ``low`` up to ``high``, and the rows added to end a surface's."""
        first = max(low - 1, 0)
        block = _dated(self.block.select(slice(first, high))).select(slice(low - first, None))
        before, after = np.searchsorted(self._ended, [low, high])
        rows = np.arange(high - low)
        where = np.sort(np.concatenate([rows, self._ended[before:after] - low]), kind="stable")
        is_added = np.concatenate([[False], np.diff(where) == 0])
        block = block.select(where)
        later = np.where(is_added, self._interval_us, 0)
        return replace(
            block,
            order=low + int(before) + np.arange(len(block)),
            t_us=block.t_us + later,
            received_us=block.received_us + later,
            has_yaw=block.has_yaw & ~is_added,
        )


def _dated(block: RecordBlock) -> RecordBlock:
    """Return the rows, each with Unix minus boot time of the row before it.

    The next row's rudder completes a sample, which must not depend on that row's date.
    """
    offset_us, steps = block.received_us - block.t_us, np.diff(block.t_us)
    goes_on = np.concatenate([[False], (steps > 0) & (steps <= 1e6 * GONE_S)])
    before = np.where(goes_on, np.roll(offset_us, 1), offset_us)
    return replace(block, received_us=block.t_us + before)


def _ended(block: RecordBlock) -> tuple[Ints, int]:
    """Return after which rows a row of the surfaces is to be added, and how many us later.

    A row's rudder holds until the next row; before a gap, and at the end, it holds one interval.
    """
    rows = np.flatnonzero(block.has_surfaces | ~block.has_yaw)
    t_us, ends = block.t_us[rows], ~block.has_surfaces[rows]
    interval_us = usual_interval_us(t_us[~ends])
    steps = np.diff(t_us)
    last = (steps > BRIDGED * interval_us + JITTER_US) | (steps <= -BACK_US) | ends[1:]
    return rows[np.append(last, True) & ~ends], interval_us


def usual_interval_us(t_us: Ints) -> int:
    """Return the median of the forward steps of times (n,) in us, 0 where there is none."""
    steps = np.diff(t_us)
    steps = steps[steps > 0]
    return int(np.median(steps, overwrite_input=True)) if len(steps) else 0


def _filled(block: RecordBlock) -> RecordBlock:
    """Return the rows with the values of other channels at the time of each row."""
    columns: dict[str, Any] = {}
    edges = [0, *(np.flatnonzero(np.diff(block.t_us) <= -BACK_US) + 1).tolist(), len(block)]
    kinds = {name: CHANNELS[name].kind for name in RecordBlock.__slots__ if name in CHANNELS}
    # The yaw rate has rows of its own.
    linear = [each for each, kind in kinds.items() if kind == "linear" and each != "r"]
    for name in [*linear, *(each for each in block.measured if each != "rudder")]:
        values = getattr(block, name)
        if np.isfinite(values).any() and not np.isfinite(values).all():
            parts = [_between(block.t_us[a:b], values[a:b], is_angle=name == "yaw")
                     for a, b in pairwise(edges)]  # fmt: skip
            columns[name] = np.concatenate(parts)
    for name in ("aileron", "by_ground", *(each for each in kinds if kinds[each] == "held")):
        columns[name] = newest(columns.get(name, getattr(block, name)))
    return replace(block, **columns)


def newest(values: Floats) -> Floats:
    """Return values (n,) with each NaN replaced by the last known value before it."""
    known = np.isfinite(values)
    if known.all() or not known.any():
        return values
    at = np.maximum.accumulate(np.where(known, np.arange(len(values)), -1))
    return np.where(at >= 0, values[np.maximum(at, 0)], np.nan)


def _between(t_us: Ints, values: Floats, *, is_angle: bool) -> Floats:
    """Return values (n,) with missing ones interpolated between their neighbours."""
    known, filled = np.isfinite(values), values.copy()
    filled[~known] = between(
        t_us[~known], t_us[known], values[known], 1e6 * GONE_S, is_angle=is_angle
    )
    return filled


def largest_stroke(t_us: Ints, values: Floats) -> float:
    """Return how far values (n,) moved at most within 5 s, 0 where they never moved."""
    known = np.isfinite(values)
    second, found = t_us[known] // int(1e6 * STRETCH_S), values[known]
    starts = np.flatnonzero(np.diff(second, prepend=second[:1] - 1) != 0)
    if not len(starts):
        return 0.0
    high, low = np.maximum.reduceat(found, starts), np.minimum.reduceat(found, starts)
    when, most = second[starts], 0.0
    for count in range(min(round(WINDOW_S / STRETCH_S), len(starts))):  # so many stretches later
        n = len(starts) - count
        near = (when[count:] - when[:n] >= 0) & (when[count:] - when[:n] < WINDOW_S / STRETCH_S)
        reach = np.maximum(high[count:] - low[:n], high[:n] - low[count:])[near]
        most = max(most, float(reach.max(initial=0.0)))
    return most


def in_flight(block: RecordBlock) -> Bools:
    """Return which rows (n,) are flown by ``on_ground``, or else by the speed; all where unknown.

    A speed below half of the fastest tenth's is that of taxi, a take-off roll or a landing roll.
    """
    speeds = [newest(each) for each in (block.airspeed, block.ground_speed)]
    speed = next((each for each in speeds if np.isfinite(each).any()), speeds[0])
    flown: Bools = newest(block.on_ground) != 1.0
    if np.isfinite(speed).any():
        flown &= ~(speed < SLOW * np.nanpercentile(speed, FAST_PCT))
    return flown if flown.any() else ~flown


def largest(values: Floats) -> float:
    """Return the largest absolute value of the finite ones (n,), 0 where there is none."""
    return float(np.max(np.abs(values), initial=0.0, where=np.isfinite(values)))
