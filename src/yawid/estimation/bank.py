"""A bank of estimators over the same samples: the method asked for, and others to check it.

It keeps the newest samples of a run.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from yawid.blocks import EstimateBlock, Floats, Held, Ints, SampleBlock
from yawid.config.run import RunConfig
from yawid.estimation.reference import make_estimator

HISTORY = 2**19
"""The most samples kept: seven hours at 20 Hz; only the end of a longer run is judged."""
COLUMNS = ("u", "y", "roll", "turn_rate", "airspeed", "aileron", "mode")
"""What is kept of the samples, next to each method's prediction of y."""
MEMORIES = 3.0
"""A forgetting model is scored on the last three memory lengths only."""


class Ring:
    """The newest ``limit`` rows of several columns, each in a ring buffer.

    A ring buffer does not move in memory: thousands of arrays of one sample each, from a live
    session, would fragment the memory of the process for hours.
    """

    def __init__(self, limit: int) -> None:
        self.limit = limit
        self.seen = 0
        self._rings: list[Floats] = []

    def __len__(self) -> int:
        return min(self.seen, self.limit)

    def add(self, *columns: Floats) -> None:
        """Append n rows; the columns (n, ...) of every call have the same further dimensions."""
        if not self._rings:
            # Memory that is never written to is not used: a short record stays small.
            self._rings = [np.empty((self.limit, *column.shape[1:])) for column in columns]
        count = len(columns[0])
        rows = np.arange(self.seen, self.seen + count)[-self.limit :] % self.limit
        for ring, column in zip(self._rings, columns, strict=True):
            ring[rows] = column[-self.limit :]
        self.seen += count

    def joined(self, newest: int) -> tuple[Floats, ...]:
        """Return so many rows (n, ...) of each column, or all, the oldest first.

        There are no columns before the first row.
        """
        rows = np.arange(self.seen - min(len(self), newest), self.seen) % self.limit
        return tuple(ring[rows] for ring in self._rings)


@dataclass(frozen=True, slots=True)
class SampleHistory:
    """Samples as the estimators took them, NaN where held: ``u`` (n, inputs), all others (n,).

    ``u`` in half travels (the rudder in rad with ``--rudder-max-deg``), ``y`` in rad/s, ``roll`` in
    rad, ``turn_rate`` in rad/s, ``airspeed`` in m/s, ``aileron`` in half travels, whether it is an
    input or not, ``mode`` HEARTBEAT.custom_mode; ``y_hat`` in rad/s by method.
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
        """Indices (m,) of the rows that have all of u and y."""
        return np.flatnonzero(np.isfinite(self.y) & np.isfinite(self.u).all(axis=1))


class Bank:
    """Runs the estimators of a configuration; at each change of epoch all of them start again.

    ``taken`` counts the samples, and ``grounded`` those of them that were held as on the ground.
    """

    def __init__(self, config: RunConfig, sample_time_s: float) -> None:
        self.config = config
        self.sample_time_s = sample_time_s
        self.methods = config.bank_methods()
        self.taken, self.grounded = 0, 0
        self._epoch: int | None = None
        self._start_again()

    def _start_again(self) -> None:
        """Make new estimators, and empty the record of samples and models."""
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
        self.last: dict[str, EstimateBlock] = {}

    def run(self, samples: SampleBlock) -> dict[str, EstimateBlock]:
        """Return each method's estimates of a block of samples of one epoch, a row per sample."""
        epoch = int(samples.epoch[0])
        if self._epoch is not None and epoch != self._epoch:
            self._start_again()
        self._epoch = epoch
        self.taken += len(samples)
        self.grounded += int(np.count_nonzero(samples.held & Held.ON_GROUND))
        self.last = {
            method: estimator.run(samples.u, samples.y, covariance=True)
            for method, estimator in self.estimators.items()
        }
        predictions = [block.y_hat for block in self.last.values()]
        self._record.add(*(getattr(samples, name) for name in COLUMNS), *predictions)
        return self.last

    def history(self, newest: int = HISTORY) -> SampleHistory:
        """Return the samples of the epoch on which the model is scored, and each prediction of y.

        They are the ``newest`` at most, and no more than three memories where the model forgets.
        """
        columns = self._record.joined(newest)
        y_hat = dict(zip(self.methods, columns[len(COLUMNS) :], strict=True))
        return SampleHistory(**dict(zip(COLUMNS, columns, strict=False)), y_hat=y_hat)
