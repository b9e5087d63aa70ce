"""A bank of estimators over the same samples: the one asked for, the others as evidence.

It keeps the newest samples of a run, and its models as they stood at times.
"""

import copy
import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from yawid.blocks import EstimateBlock, Floats, Ints, SampleBlock
from yawid.config.run import RunConfig
from yawid.estimation.reference.estimator import make_estimator

HISTORY = 2**19
"""Samples kept at most: seven hours at 20 Hz; a longer run is judged by its end."""
MEMORIES = 3.0
"""A model that forgets is asked about three times its memory, what it still knows something of."""
REMEMBERED = 16
"""Every so many samples the model is kept as it stood, to be asked about what came after."""


class Ring:
    """The newest ``limit`` rows of what the columns of :class:`SampleHistory` are, in a ring each.

    A ring lies still: parts of a live session, a sample each, would hold the process's memory apart
    for hours.
    """

    def __init__(self, limit: int) -> None:
        self.limit = limit
        self.seen = 0
        self._rings: list[Floats] = []

    def __len__(self) -> int:
        return min(self.seen, self.limit)

    def add(self, *columns: Floats) -> None:
        """Append rows; columns (n, ...) are the same in every call but for n."""
        if not self._rings:
            # Memory that was never written to is not taken: a short record stays small.
            self._rings = [np.empty((self.limit, *column.shape[1:])) for column in columns]
        count = len(columns[0])
        rows = np.arange(self.seen, self.seen + count)[-self.limit :] % self.limit
        for ring, column in zip(self._rings, columns, strict=True):
            ring[rows] = column[-self.limit :]
        self.seen += count

    def joined(self) -> tuple[Floats, ...]:
        """Return the columns (n, ...) of the newest rows, the oldest first; none before any row."""
        rows = np.arange(self.seen - len(self), self.seen) % self.limit
        return tuple(ring[rows] for ring in self._rings)

    def snapshot(self) -> "Ring":
        """Return a copy that may be read, not added to."""
        taken = copy.copy(self)
        taken._rings = [ring[: len(self)].copy() for ring in self._rings]
        return taken


@dataclass(frozen=True, slots=True)
class SampleHistory:
    """Samples as the estimators saw them: ``u`` (n, inputs), the rest (n,), held ones as NaN.

    ``y`` in rad/s, ``roll`` in rad, ``turn_rate`` in rad/s, ``airspeed`` in m/s, ``aileron`` in
    units of half its travel, whether it is an input or not, ``mode`` HEARTBEAT.custom_mode.
    """

    u: Floats
    y: Floats
    roll: Floats
    turn_rate: Floats
    airspeed: Floats
    aileron: Floats
    mode: Floats
    y_hat: Mapping[str, Floats]

    @property
    def good(self) -> Ints:
        """The rows (m,) that the estimators could use."""
        return np.flatnonzero(np.isfinite(self.y) & np.isfinite(self.u).all(axis=1))


@dataclass(frozen=True, slots=True)
class PastModels:
    """The models as they stood before row ``first`` of the history: theta (n,) of each method."""

    first: int
    theta: Mapping[str, Floats]


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
        further = ("roll", "turn_rate", "airspeed", "aileron", "mode")
        context = [getattr(samples, name) for name in further]
        self._remember(len(samples))
        self._record.add(samples.u, samples.y, *context, *predictions)
        return self.last

    def snapshot(self) -> "Bank":
        """Return the bank as it stands, for another thread to judge while this one runs on."""
        taken = copy.copy(self)
        taken.estimators = copy.deepcopy(self.estimators)
        taken._record, taken._thetas = self._record.snapshot(), self._thetas.snapshot()
        return taken

    def _remember(self, count: int) -> None:
        """Keep theta after every 16th sample of the epoch, however the blocks were cut."""
        before = self._record.seen
        rows = slice(-(before + 1) % REMEMBERED, None, REMEMBERED)
        seen = np.arange(before + 1.0, before + count + 1.0)[rows]
        if len(seen):
            self._thetas.add(seen, *(block.theta[rows] for block in self.last.values()))

    def history(self) -> SampleHistory:
        """Return the newest samples of the epoch and what each method predicted of them.

        As many as the model can be asked about: all of them, or three times its memory.
        """
        columns = self._record.joined()
        own = len(columns) - len(self.methods)
        u, y, roll, turn, airspeed, aileron, mode = columns[:own]
        y_hat = dict(zip(self.methods, columns[own:], strict=True))
        return SampleHistory(u, y, roll, turn, airspeed, aileron, mode, y_hat)

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
