"""How long a sample waits: from the arrival of the last frame it needs to its estimate."""

from __future__ import annotations

import numpy as np

from yawid.blocks import Ints

_STEP_US = 250
_BINS = 4000  # to 1 s; what takes longer counts as that


class Latency:
    """Counts waiting times in bins of a quarter of a millisecond: any number in the same memory."""

    def __init__(self) -> None:
        self._counts = np.zeros(_BINS, np.int64)

    @property
    def count(self) -> int:
        """How many samples were counted."""
        return int(self._counts.sum())

    def add(self, waited_us: Ints) -> None:
        """Count waiting times (n,) in microseconds."""
        np.add.at(self._counts, np.clip(waited_us // _STEP_US, 0, _BINS - 1), 1)

    def summary(self) -> dict[str, float]:
        """Return p50, p99 and the longest in milliseconds, each the upper edge of its bin."""
        summed = np.cumsum(self._counts)
        ranks = {"p50": 0.5, "p99": 0.99, "max": 1.0}
        return {
            name: (int(np.searchsorted(summed, share * summed[-1])) + 1) * _STEP_US / 1000.0
            for name, share in ranks.items()
        }
