"""Notes on samples that update the estimators all the same: another airspeed, a rudder at rest.

Both are causal and see only samples that are used. Held ones say why they are held instead.
"""

import math
from dataclasses import dataclass, field, replace

import numpy as np

from yawid.blocks import AIRSPEED_SHARE, LEAST_TRAVEL, WINDOW_S, Bools, Floats, Noted, SampleBlock
from yawid.config.run import DEFAULT_MEMORY_S


def window_of(sample_time_s: float) -> int:
    """Return the samples in a window of excitation."""
    return max(2, round(WINDOW_S / sample_time_s))


def strokes(u: Floats, window: int, before: Floats | None = None) -> Floats:
    """Return how far ``u`` (n,) moved within the last ``window`` samples, at each of them (n,).

    ``before`` (m,) are the values that came before; where there are fewer than a window, the first
    is taken to have lasted.
    """
    carried = u[:0] if before is None else before[-(window - 1) :]
    known = np.concatenate([carried, u])
    padded = np.concatenate([np.full(window - 1 - len(carried), known[0]), known])
    return extremes(np.maximum, padded, window) - extremes(np.minimum, padded, window)


def extremes(of_two: np.ufunc, x: Floats, window: int) -> Floats:
    """Return the extreme of each ``window`` values of x (n,), (n - window + 1,), by doubling."""
    width = 1
    while 2 * width <= window:
        x, width = of_two(x[:-width], x[width:]), 2 * width
    rest = window - width
    found: Floats = of_two(x[: len(x) - rest], x[rest:])
    return found


@dataclass(slots=True)
class Notes:
    """Adds the notes to conditioned samples; carries the mean airspeed and the newest rudder.

    The airspeed is compared with its mean over the minute before, older ones counting
    exponentially less: as long as a default estimator remembers, whatever this one does.
    ``travel_unit`` is half the rudder's travel in the unit of ``u``.
    """

    sample_time_s: float
    travel_unit: float
    _sums: tuple[float, float] = (0.0, 0.0)
    _rudder: Floats = field(default_factory=lambda: np.zeros(0))
    _epoch: int = -1

    def feed(self, block: SampleBlock) -> SampleBlock:
        """Return the block with AIRSPEED_CHANGED and NOT_EXCITED noted."""
        used = block.held == 0
        noted = block.noted.copy()
        noted[used & self._other_airspeed(block, used)] |= int(Noted.AIRSPEED_CHANGED)
        noted[used & self._at_rest(block, used)] |= int(Noted.NOT_EXCITED)
        return replace(block, noted=noted)

    def _other_airspeed(self, block: SampleBlock, used: Bools) -> Bools:
        rows = used & np.isfinite(block.airspeed)
        other = np.zeros(len(block), bool)
        if not rows.any():
            return other
        speed = block.airspeed[rows]
        forgetting = math.exp(-self.sample_time_s / DEFAULT_MEMORY_S)
        total, weight = self._sums
        means = []
        for x in speed.tolist():
            total, weight = forgetting * total + x, forgetting * weight + 1.0
            means.append(total / weight)
        self._sums, mean = (total, weight), np.array(means)
        other[rows] = np.abs(speed - mean) > AIRSPEED_SHARE * mean
        return other

    def _at_rest(self, block: SampleBlock, used: Bools) -> Bools:
        if block.epoch[0] != self._epoch:
            self._epoch, self._rudder = int(block.epoch[0]), np.zeros(0)
        at_rest = np.zeros(len(block), bool)
        if not used.any():
            return at_rest
        u, window = block.u[used, 0] / self.travel_unit, window_of(self.sample_time_s)
        at_rest[used] = strokes(u, window, self._rudder) < LEAST_TRAVEL
        self._rudder = np.concatenate([self._rudder, u])[-(window - 1) :]
        return at_rest
