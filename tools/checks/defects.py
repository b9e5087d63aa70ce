"""The seeded defects of defects.toml: small mistakes that a careless change could make."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True, slots=True)
class Defect:
    """A defect: ``old`` in ``file`` (below src/yawid) becomes ``new``; then ``test`` must fail."""

    what: str
    file: str
    old: str
    new: str
    test: str


DEFECTS: tuple[Defect, ...] = tuple(
    Defect(**each)
    for each in tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))[
        "defect"
    ]
)
