"""A bank of estimators over the same samples: the one asked for, the others as evidence."""

from __future__ import annotations

import math

import numpy as np

from yawid.blocks import EstimateBlock, SampleBlock
from yawid.config.run import RunConfig
from yawid.estimation.history import History, PastModels, Ring
from yawid.estimation.reference.estimator import make_estimator

HISTORY = 2**19
"""Samples kept at most: seven hours at 20 Hz; a longer run is judged by its end."""
MEMORIES = 3.0
"""A model that forgets is asked about three times its memory, what it still knows something of."""
REMEMBERED = 16
"""Every so many samples the model is kept as it stood, to be asked about what came after."""


class Bank:
    """Runs the estimators of a configuration; each change of epoch starts all of them anew."""

    def __init__(self, config: RunConfig, sample_time_s: float) -> None:
        self.config = config
        self.sample_time_s = sample_time_s
        self.methods = config.bank_methods()
        self._epoch: int | None = None
        self._start_anew()

    def _start_anew(self) -> None:
        self.estimators = {
            method: make_estimator(
                self.config.estimator(method, self.sample_time_s),
                "filterpy" if self.config.engine == "filterpy" else "numba",
            )
            for method in self.methods
        }
        forgotten = 1.0 - self.config.forgetting_factor(self.sample_time_s)
        kept = math.ceil(MEMORIES / forgotten) if forgotten > 0.0 else HISTORY
        self._record = Ring(min(kept, HISTORY))
        self._thetas = Ring(min(kept, HISTORY) // REMEMBERED + 1)
        self.last: dict[str, EstimateBlock] = {}

    def run(self, samples: SampleBlock) -> dict[str, EstimateBlock]:
        """Return each method's estimates of a block of samples of one epoch, a row per sample."""
        epoch = int(samples.epoch[0])
        if self._epoch is not None and epoch != self._epoch:
            self._start_anew()
        self._epoch = epoch
        self.last = {
            method: estimator.run(samples.u, samples.y, covariance=True)
            for method, estimator in self.estimators.items()
        }
        predictions = [block.y_hat for block in self.last.values()]
        further = ("roll", "turn", "airspeed", "aileron", "mode")
        context = [getattr(samples, name) for name in further]
        self._remember(len(samples))
        self._record.add(samples.u, samples.y, *context, *predictions)
        return self.last

    def _remember(self, count: int) -> None:
        """Keep theta after every 16th sample of the epoch, however the blocks were cut."""
        before = self._record.seen
        rows = slice(-(before + 1) % REMEMBERED, None, REMEMBERED)
        seen = np.arange(before + 1.0, before + count + 1.0)[rows]
        if len(seen):
            self._thetas.add(seen, *(block.theta[rows] for block in self.last.values()))

    def history(self) -> History:
        """Return the newest samples of the epoch and what each method predicted of them.

        As many as the model can be asked about: all of them, or three times its memory.
        """
        columns = self._record.joined()
        own = len(columns) - len(self.methods)
        u, y, roll, turn, airspeed, aileron, mode = columns[:own]
        y_hat = dict(zip(self.methods, columns[own:], strict=True))
        return History(u, y, roll, turn, airspeed, aileron, mode, y_hat)

    def earlier(self, row: int) -> PastModels | None:
        """Return the newest models kept that had not seen ``row`` of the history, if there are."""
        seen, *thetas = self._thetas.joined() or (np.empty(0),)
        firsts = seen - (self._record.seen - len(self._record))
        known = np.flatnonzero((firsts > 0) & (firsts <= row))
        if len(known) == 0:
            return None
        newest = known[-1]
        models = {name: theta[newest] for name, theta in zip(self.methods, thetas, strict=True)}
        return PastModels(int(firsts[newest]), models)
