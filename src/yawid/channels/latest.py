"""The newest values of a message at any place of the stream."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from yawid.blocks import Floats, Ints, MessageBlock


@dataclass(slots=True)
class Latest:
    """The newest values of a message before any place of the stream, NaN before the first."""

    columns: int
    order: Ints = field(default_factory=lambda: np.full(1, -1, np.int64))
    values: Floats = field(init=False)

    def __post_init__(self) -> None:
        self.values = np.full((1, self.columns), np.nan)

    def observe(self, block: MessageBlock | None, read: Callable[[NDArray[Any]], Floats]) -> None:
        """Take a block in; of what came before only the newest row is still needed.

        ``read`` makes values (n, columns) of its fields (n,).
        """
        if block is None:
            self.add(self.order[:0], np.zeros((0, self.columns)))
        else:
            self.add(block.order, read(block.fields))

    def add(self, order: Ints, values: Floats) -> None:
        """Take in values (n, columns) reported at places ``order`` (n,), like :meth:`observe`."""
        self.order = np.concatenate([self.order[-1:], order])
        self.values = np.concatenate([self.values[-1:], values])

    def at(self, order: Ints) -> Floats:
        """Return the values (n, columns) held at each place."""
        held: Floats = self.values[np.searchsorted(self.order, order) - 1]
        return held
