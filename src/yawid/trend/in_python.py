"""``yawid.diff``: what changed between two runs in Python, or between files."""

from os import PathLike, fspath
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Protocol

import msgspec

from yawid.errors import ConfigError
from yawid.system.stores import Place, place_of
from yawid.trend.diff import Diff
from yawid.trend.diff import diff as what_changed


class HasFile(Protocol):
    """A run in Python, which can give its file."""

    path: Place

    def mcap(self, folder: str | PathLike[str]) -> Path:
        """Return the path of the run's MCAP, which may be written into ``folder``."""


Side = HasFile | str | PathLike[str]


def diff(a: Side, b: Side) -> Diff:
    """Return what changed from A to B: each a run, the path of its MCAP, or that of a data set.

    ``.changed`` says whether something did, ``.numbers`` has each number with its difference.

    Raises:
        ConfigError: one of them is neither a run nor a path.
        SourceError: one of them is neither a finished run nor a data set.
    """
    for each in (a, b):
        if not isinstance(each, str | PathLike) and not hasattr(each, "mcap"):
            raise ConfigError(f"a side must be a run or a path, got {type(each).__name__}")
    sides = [place_of(fspath(e)) if isinstance(e, str | PathLike) else e for e in (a, b)]
    with TemporaryDirectory() as folder:
        files = [
            each if isinstance(each, Place) else each.mcap(Path(folder) / name)
            for name, each in zip("ab", sides, strict=True)
        ]
        found = what_changed(*files)
    one, other = (each if isinstance(each, Place) else each.path for each in sides)
    return msgspec.structs.replace(found, a=str(one.absolute()), b=str(other.absolute()))
