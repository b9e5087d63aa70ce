"""``yawid.diff``: what changed between two runs in Python, or between files."""

from os import PathLike, fspath
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Protocol

import msgspec

from yawid.system.stores import Place, place_of
from yawid.trend.diff import Diff
from yawid.trend.diff import diff as what_changed


class HasFile(Protocol):
    """A run in Python, which can give its file."""

    path: Place

    def mcap(self, folder: Path) -> Path:
        """Return the path of the run's MCAP, which may be written into ``folder``."""


Side = HasFile | str | PathLike[str]


def diff(a: Side, b: Side) -> Diff:
    """Return what changed from A to B: each a run, the path of its MCAP, or that of a data set.

    ``.changed`` says whether something did, ``.numbers`` has each number with its difference.

    Raises:
        SourceError: one of them is neither a finished run nor a data set.
    """
    with TemporaryDirectory() as folder:
        files = [
            place_of(fspath(each))
            if isinstance(each, str | PathLike)
            else each.mcap(Path(folder) / name)
            for name, each in (("a", a), ("b", b))
        ]
        found = what_changed(*files)
    paths = [
        place_of(fspath(each)) if isinstance(each, str | PathLike) else each.path for each in (a, b)
    ]
    return msgspec.structs.replace(found, a=str(paths[0].absolute()), b=str(paths[1].absolute()))
