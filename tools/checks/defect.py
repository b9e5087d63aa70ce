"""A small defect, seeded in a copy of the tree to see whether a test notices (tools/mutate.py)."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Defect:
    """``old``, once in ``file`` (below src/yawid), becomes ``new``; then ``test`` must fail."""

    what: str
    file: str
    old: str
    new: str
    test: str
