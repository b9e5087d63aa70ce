"""Where the files of a data set lie, which are its own, and how new ones take the place of old.

    DATASET/manifest.json                                        which files count, with their rows
    DATASET/logs/part-000001-0.parquet
    DATASET/flights/month=2026-03/part-000001-0.parquet          runs, manoeuvres, modes likewise
    DATASET/_new/flights/month=2026-03/part-000002-0.parquet     made, and not in its place yet

The manifest is a journal. New files are made below ``_new``, outside of the folders that people
read by a glob; the manifest that names them is written last, and makes them count. Then the files
it does not name go, and at last the new ones come to their places: a glob never reads a row twice.
After a kill this is completed by the next fleet; until then a glob may read short, which our own
reader does not, and what no manifest names is removed.

Only a manifest makes a folder a data set, and only files with names of our own form are removed:
whatever else lies there stays as it is.
"""

import json
import re
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO, Final

from yawid.dataset.schema import FORMAT, TABLES
from yawid.dataset.values import ReadRow, Row
from yawid.errors import SourceError

MANIFEST: Final = "manifest.json"
NEW: Final = "_new"
"""Where files are made: next to the tables' folders, as some globs match hidden names too."""
NO_MONTH: Final = "unknown"
"""Of rows without a date. Hive's own word for it reads as a null, which pandas does not take."""
_PART: Final = r"part-\d{6,}-\d+\.parquet"
_OLD_NO_MONTH: Final = "__HIVE_DEFAULT_PARTITION__"
"""What an older version called it: such a file is written again by the next merge."""
_MONTH: Final = rf"month=(\d{{4}}-\d{{2}}|{NO_MONTH}|{_OLD_NO_MONTH})"
_OWN: Final = re.compile(
    "|".join(
        f"{table.name}/{_MONTH}/{_PART}" if table.by_month else f"{table.name}/{_PART}"
        for table in TABLES.values()
    )
)
"""Names of our own form, below the data set's folder."""


def read_manifest(folder: Path) -> Row:
    """Return the manifest: ``tables`` by name with ``rows`` and ``files``; ``outcomes`` counted.

    Raises:
        SourceError: there is no data set, or one of another format.
    """
    path = folder / MANIFEST
    try:
        found = json.loads(path.read_bytes())
        if found["format"] != FORMAT:
            raise SourceError(f"{path} has format {found['format']}, this version reads {FORMAT}")
        others = [name for name in _named(found) if _OWN.fullmatch(name) is None]
        found["generation"] + 0, dict(found["outcomes"])
    except FileNotFoundError:
        raise SourceError(f"{folder} is not a data set: it has no {MANIFEST}") from None
    except OSError as error:
        raise SourceError(f"{path} cannot be read: {error.strerror}") from error
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise SourceError(f"{path} is not a data set's manifest: {error}") from error
    if others:
        raise SourceError(f"{path} is not a data set's manifest: it names {others[0]}")
    manifest: Row = found
    return manifest


def complete(folder: Path, manifest: ReadRow) -> None:
    """Bring the files to what the manifest says, wherever a kill has left them.

    Raises:
        OSError: one cannot be removed or moved.
    """
    named = set(_named(manifest))
    for name in set(_own_files(folder)) - named:
        (folder / name).unlink(missing_ok=True)
    new = folder / NEW
    for name in set(_own_files(new)):
        if name in named:
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (new / name).replace(folder / name)
        else:
            (new / name).unlink(missing_ok=True)
    tables = [each / table for each in (folder, new) for table in TABLES]
    months = [path for table in tables for path in table.glob("month=*")]
    ours = [path for path in months if re.fullmatch(_MONTH, path.name)]
    for path in (*ours, *tables[len(TABLES) :], new):
        if path.is_dir() and not any(path.iterdir()):
            path.rmdir()


def opened(folder: Path, name: str) -> BinaryIO:
    """Open a file that a manifest names, which may lie among the new ones still.

    Raises:
        OSError: it cannot be read.
    """
    with suppress(FileNotFoundError):
        return (folder / name).open("rb")
    with suppress(FileNotFoundError):
        return (folder / NEW / name).open("rb")
    return (folder / name).open("rb")  # it came to its place just now


def month_of(name: str) -> str:
    """Return the month of a file that a manifest names, ``NO_MONTH`` of undated rows."""
    month = Path(name).parent.name.removeprefix("month=")
    return NO_MONTH if month == _OLD_NO_MONTH else month


def _named(manifest: ReadRow) -> list[str]:
    return [each["path"] for table in manifest["tables"].values() for each in table["files"]]


def _own_files(folder: Path) -> Iterator[str]:
    for table in TABLES:
        for path in (folder / table).rglob("part-*.parquet"):
            name = path.relative_to(folder).as_posix()
            if _OWN.fullmatch(name):
                yield name
