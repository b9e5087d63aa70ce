"""Whether a session stands still, and how long samples wait to be estimated."""

import numpy as np

from yawid.blocks import Ints, Status, words
from yawid.pipeline import Pipeline

QUIET_S = 1.5
"""After this long without data or samples, the last estimate is no longer shown as current."""
_LATE_S = 0.3
"""A busy machine may read the last bytes this much later than they arrived."""
_STEP_US = 250
_BINS = 4000  # up to 1 s; a longer wait is counted in the last bin


class Standing:
    """Whether a session stands still; ``received_us`` is when its last bytes came, or 0."""

    def __init__(self) -> None:
        self.received_us = 0
        self._is_idle = False

    def stopped(self, pipeline: Pipeline, now_us: int) -> bool:
        """Return whether samples have stopped arriving since the last call."""
        was_idle, self._is_idle = self._is_idle, _idle_s(pipeline, now_us) > 0.0
        return self._is_idle and not was_idle

    def quiet(self, pipeline: Pipeline, now_us: int) -> str:
        """Return a text on a link or vehicle that has fallen silent, "" where none has."""
        quiet_s, idle_s = (now_us - self.received_us) / 1e6, _idle_s(pipeline, now_us)
        ends_with_samples = idle_s > 0.0 and idle_s - quiet_s < _LATE_S
        if self.received_us and (quiet_s > QUIET_S or ends_with_samples):
            return f"nothing received for {quiet_s:.0f} s"
        return f"no sample for {idle_s:.0f} s" if idle_s else ""


def state(pipeline: Pipeline) -> str:
    """Return the status of the method in words, "" before its first estimate."""
    if pipeline.bank is None or not pipeline.bank.last:
        return ""
    return words(Status(int(pipeline.bank.last[pipeline.config.method].status[-1])))


def _idle_s(pipeline: Pipeline, now_us: int) -> float:
    """Return for how many seconds no sample has come; 0 while they come or before the first."""
    if pipeline.bank is None or pipeline.newest is None:
        return 0.0
    idle_s = (now_us - int(pipeline.newest.received_us[-1])) / 1e6
    return idle_s if idle_s > QUIET_S + 2.0 * pipeline.bank.sample_time_s else 0.0


class Latency:
    """A count of waiting times in bins of 0.25 ms, so that its memory does not grow."""

    def __init__(self) -> None:
        self._counts = np.zeros(_BINS, np.int64)

    @property
    def count(self) -> int:
        """The number of samples counted."""
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
