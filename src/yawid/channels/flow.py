"""How fast a channel's messages come, over all the time in which they do."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from yawid.blocks import Ints

LONGEST_US = 2_000_000
"""Over a longer step nothing flowed: a gap, or a clock that leapt."""


@dataclass(slots=True)
class Flow:
    """Counts one channel's steps from message to message on the vehicle's clock.

    A message that came twice, or late, is no step of its own.
    """

    steps: int = 0
    flowed_us: int = 0
    _newest_us: int | None = None

    def observe(self, t_us: Ints) -> None:
        """Take in the times (n,) of its rows."""
        if len(t_us) == 0:
            return
        before = np.append(t_us[:1] if self._newest_us is None else self._newest_us, t_us)
        steps = np.diff(before)
        flowing = (steps > 0) & (steps <= LONGEST_US)
        self.steps += int(flowing.sum())
        self.flowed_us += int(steps[flowing].sum())
        self._newest_us = int(t_us[-1])

    @property
    def rate_hz(self) -> float:
        """The mean rate while it flowed, NaN before there are two steps."""
        return 1e6 * self.steps / self.flowed_us if self.steps >= 2 else math.nan
