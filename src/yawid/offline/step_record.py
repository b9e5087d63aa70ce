"""A step response as measured: checked, scaled to run from 0 to 1, read off as the paper does."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from yawid.blocks import Floats
from yawid.errors import ConfigError, NotIdentifiable
from yawid.offline.step_forms import second_order_from_peak

FEWEST_SAMPLES = 10
SMOOTHING = (0.0, 0.01, 0.03)
"""Widths of the moving average before the reading, as shares of the record."""
TAIL = 0.1
"""The share of the record whose mean is read as the steady state."""
CLEAR = 3.0
"""By how many sigma the answer to the step, an overshoot and a misfit must stand out."""


@dataclass(frozen=True, slots=True)
class Record:
    """t since the step, y less ``low`` over ``scale``: from 0 to 1 or so, and the scaled noise."""

    t: Floats
    y: Floats
    low: float
    scale: float
    noise: float

    @classmethod
    def checked(cls, times: ArrayLike, values: ArrayLike, u0: float, step_time_s: float) -> Record:
        """Return the record of y (n,) at t (n,); raises as the fits in ``step_response.py`` do."""
        t, y = np.asarray(times, dtype=np.float64), np.asarray(values, dtype=np.float64)
        if t.ndim != 1 or t.shape != y.shape:
            raise ConfigError(f"t and y must be (n,) alike, got {t.shape} and {y.shape}")
        if not np.isfinite(t).all() or np.isinf(y).any() or not (np.diff(t) > 0.0).all():
            raise ConfigError("t must be finite and increasing and y finite (NaN where missing)")
        if not math.isfinite(u0) or u0 == 0.0 or not math.isfinite(step_time_s):
            raise ConfigError(
                f"u0 must be finite and not 0, got {u0!r} (step at {step_time_s!r} s)"
            )
        t, y = t[np.isfinite(y)] - step_time_s, y[np.isfinite(y)]
        after = int(np.sum(t >= 0.0))
        if after < FEWEST_SAMPLES:
            raise ConfigError(f"{after} samples after the step, at least {FEWEST_SAMPLES} needed")
        before, tail = max(len(y) - after, 1), max(1, round(TAIL * after))
        low, scale = float(y[:before].mean()), float(y[-tail:].mean() - y[:before].mean())
        noise = float(np.median(np.abs(np.diff(y)))) / 0.954  # of a normal difference of two
        if not abs(scale) > CLEAR * noise * math.sqrt(1.0 / before + 1.0 / tail):
            raise NotIdentifiable(
                f"y does not answer the step: its change of {scale:.3g} is not clear of the noise"
            )
        return cls(t, (y - low) / scale, low, scale, noise / abs(scale))

    def smoothed(self) -> Iterator[tuple[Floats, Floats]]:
        """Yield t and y (m,) from the step on, y averaged over ever more samples."""
        t, y = self.t[self.t >= 0.0], self.y[self.t >= 0.0]
        for width in sorted({2 * round(0.5 * share * len(y)) + 1 for share in SMOOTHING}):
            mean = np.convolve(y, np.ones(width) / width, mode="valid")
            yield t[width // 2 : len(t) - width // 2], mean


def read_first_order(record: Record) -> Iterator[float]:
    """Yield T, the time at which the response reaches 63 % of its end (after eq. 6)."""
    level = 1.0 - math.exp(-1.0)
    for t, y in record.smoothed():
        after = int(np.argmax(y >= level))
        if after == 0:
            yield float(max(t[0], 0.5 * (t[1] - t[0])))
            continue
        part = (level - y[after - 1]) / (y[after] - y[after - 1])
        yield float(t[after - 1] + part * (t[after] - t[after - 1]))


def read_second_order(record: Record) -> Iterator[tuple[float, float]]:
    """Yield D and q by eq. 12-13 from the first extremum; none where there is no overshoot."""
    for t, y in record.smoothed():
        peak, y_max = float(t[np.argmax(y)]), float(y.max())
        if 0.0 < y_max - 1.0 < 1.0 and peak > 0.0:
            _, D, q = second_order_from_peak(1.0, y_max, peak)
            yield D, q
