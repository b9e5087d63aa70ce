"""From a finer grid to the one asked for, through one low-pass for all channels.

What vibrates above half the grid's rate would stand in its samples as a slow motion that no filter
on the grid can take out again. So with ``--band`` the channels are aligned on a grid as fine as
their messages, pass the same Butterworth low-pass there, and are thinned out: y at the instant, u
as the mean over the interval, as ever. SciPy is loaded where a band asks for it: it takes half a
second.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from yawid.blocks import Floats, Ints, SampleBlock, runs_of

BAND_ORDER = 2
"""Order of the Butterworth at either end of the band."""
RATE_SLACK = 0.98
"""Measured message rates jitter: 4.95 Hz counts as 5."""


def finer_by(sample_time_s: float, interval_us: float) -> int:
    """Return into how many a sample time is cut so that no message interval is longer than one."""
    return max(1, math.ceil(RATE_SLACK * 1e6 * sample_time_s / interval_us))


def butterworth(corner_hz: float | tuple[float, float], kind: str, rate_hz: float) -> Floats:
    """Return one end of the band, or both, as second-order sections (n, 6)."""
    from scipy.signal import butter

    sections: Floats = butter(BAND_ORDER, corner_hz, kind, fs=rate_hz, output="sos")
    return sections


@dataclass(slots=True)
class GridFilter:
    """One filter for inputs and output alike; carries its state from block to block."""

    sections: Floats
    _state: Floats | None = None

    def feed(self, block: SampleBlock) -> SampleBlock:
        """Return u, aileron and y filtered; after a held sample it starts again, at rest."""
        from scipy.signal import sosfilt, sosfilt_zi

        # An aileron that is not known for a while must not spoil the filter for the rest.
        unknown = np.isnan(block.aileron)
        aileron = np.where(unknown, 0.0, block.aileron)
        signals = np.column_stack([block.u, aileron, block.y])
        good = block.held == 0
        for start, stop in runs_of(good):
            if start > 0 or self._state is None:
                self._state = sosfilt_zi(self.sections)[:, :, None] * signals[start]
            signals[start:stop], self._state = sosfilt(
                self.sections, signals[start:stop], axis=0, zi=self._state
            )
        if not good[-1]:
            self._state = None
        aileron = np.where(unknown, np.nan, signals[:, -2])
        return replace(block, u=signals[:, :-2], aileron=aileron, y=signals[:, -1])


@dataclass(slots=True)
class Decimator:
    """Low-passes fine samples at ``corner_hz`` and keeps every ``count``-th.

    A sample of the grid is held if one of its fine samples is, for the same reasons; one of which
    a part is missing without a reason lies at the edge of a gap or of the log and is left out.
    """

    sample_time_s: float
    count: int
    corner_hz: float
    _filter: GridFilter = field(init=False)
    _open: SampleBlock | None = None

    def __post_init__(self) -> None:
        rate_hz = self.count / self.sample_time_s
        self._filter = GridFilter(butterworth(self.corner_hz, "low", rate_hz))

    def feed(self, block: SampleBlock) -> SampleBlock | None:
        """Take fine samples in; return those of the grid that are complete."""
        fine = self._filter.feed(block)
        if self._open is not None and self._open.epoch[0] == fine.epoch[0]:
            fine = SampleBlock.joined([self._open, fine])
        apart = (np.diff(fine.k // self.count) != 0) | (np.diff(fine.k) <= 0)
        starts = np.flatnonzero(np.concatenate([[True], apart]))
        self._open = None
        if (fine.k[-1] + 1) % self.count:
            self._open = fine.select(slice(int(starts[-1]), None))
            fine, starts = fine.select(slice(0, int(starts[-1]))), starts[:-1]
        return self._thinned(fine, starts) if len(starts) else None

    def _thinned(self, fine: SampleBlock, starts: Ints) -> SampleBlock | None:
        """Make one sample of each group of fine ones."""
        held = np.bitwise_or.reduceat(fine.held, starts)
        sizes = np.diff(np.append(starts, len(fine)))
        whole = fine.select(starts)
        k = whole.k // self.count
        block = replace(
            whole,
            sample_time_s=self.sample_time_s,
            k=k,
            boot_us=np.rint(k * (1e6 * self.sample_time_s)).astype(np.int64),
            received_us=fine.received_us[starts + sizes - 1],
            u=np.add.reduceat(fine.u, starts, axis=0) / self.count,
            aileron=np.add.reduceat(fine.aileron, starts) / self.count,
            noted=np.bitwise_or.reduceat(fine.noted, starts),
            held=held,
        )
        kept = (held != 0) | (sizes == self.count)
        return block.select(kept) if kept.any() else None
