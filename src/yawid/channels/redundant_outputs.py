"""Several outputs of one function, such as twin fins, and whether they move alike.

The first of them is the surface; the others are only compared with it.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from yawid.blocks import MessageBlock
from yawid.channels.surface import Part, Surface

TOLERANCE = 0.05
"""Outputs differ where they are this part of half the travel apart: rounding to 1 us and trims set
by hand stay well below."""
LEAST_SHARE = 0.01
"""... and do so all in all if more than this share of the messages shows it."""


@dataclass(slots=True)
class Twins:
    """Counts by message and the numbers of both outputs: messages compared, and those apart."""

    _counts: dict[tuple[str, int, int], tuple[int, int]] = field(default_factory=dict)

    def observe(self, block: MessageBlock, surface: Surface) -> None:
        """Compare the surface's twins with its first output in rows that carry both."""
        for twin in surface.twins:
            first, other = (surface.normalised(part, block) for part in (surface.parts[0], twin))
            both = np.isfinite(first) & np.isfinite(other)
            apart = np.abs(first[both] - other[both]) > TOLERANCE
            key = surface.message, surface.parts[0].number, twin.number
            compared, differed = self._counts.get(key, (0, 0))
            self._counts[key] = compared + len(apart), differed + int(apart.sum())

    def share_apart(self, surface: Surface, twin: Part) -> float:
        """Return the share of messages in which the twin stood apart, NaN where none reports."""
        key = surface.message, surface.parts[0].number, twin.number
        compared, apart = self._counts.get(key, (0, 0))
        return apart / compared if compared else float("nan")

    def how(self, surface: Surface) -> str:
        """Return how the surface was found and whether its twins move with it."""
        how = surface.how
        for twin in surface.twins:
            share = self.share_apart(surface, twin)
            if np.isfinite(share):
                alike = "moves otherwise" if share > LEAST_SHARE else "moves alike"
                how += f"; {surface.name_of(twin)} {alike}"
        return how
