"""What a bank keeps of a run: the newest samples, and its models as they stood at times."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from yawid.blocks import Floats, Ints


class Ring:
    """The newest ``limit`` rows of what the columns of :class:`History` are, in a ring each.

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


@dataclass(frozen=True, slots=True)
class History:
    """Samples as the estimators saw them: ``u`` (n, inputs), the rest (n,), held ones as NaN.

    ``y`` in rad/s, ``roll`` in rad, ``turn`` in rad/s, ``airspeed`` in m/s, ``aileron`` in units of
    half its travel, whether it is an input or not, ``mode`` HEARTBEAT.custom_mode.
    """

    u: Floats
    y: Floats
    roll: Floats
    turn: Floats
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
