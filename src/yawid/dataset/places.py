"""Where the files of a data set lie, which belong to it, and how new files replace old ones.

    DATASET/manifest.json                                        which files count, with their rows
    DATASET/logs/part-000001-0.parquet
    DATASET/flights/month=2026-03/part-000001-0.parquet          flights_by_loop, runs, ... likewise
    DATASET/_new/flights/month=2026-03/part-000002-0.parquet     made, and not in its place yet

New files are made below ``_new``, outside of the folders that people read by a glob. The manifest
that names them is written after them, and makes them part of the data set. Then the files that it
does not name are removed, and finally the new files are moved to their places: a glob never reads a
row twice. If this was interrupted by a kill, the next fleet completes it, and removes files that no
manifest names. Until then a glob may miss rows; yawid's own reader does not.

A store of objects (S3) has no folders: there a file is moved by a copy and a removal.

Only a manifest makes a folder a data set, and only files with the data set's own form of name are
removed: all other files in the folder stay as they are.
"""

import json
import re
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO, Final

from yawid.dataset.schema import FORMAT, TABLES
from yawid.dataset.values import ReadRow, Row
from yawid.errors import ConfigError, SourceError
from yawid.system.stores import Place

MANIFEST: Final = "manifest.json"
NEW: Final = "_new"
"""Folder where files are made. It is not inside a table's folder, as some globs match any name."""
NO_MONTH: Final = "unknown"
"""The month of rows without a date. Hive's own name for it reads as null, which pandas rejects."""
_PART: Final = r"part-\d{6,}-\d+\.parquet"
_OLD_NO_MONTH: Final = "__HIVE_DEFAULT_PARTITION__"
"""Its name in an older version: such a file is written again by the next merge."""
_MONTH: Final = rf"month=(\d{{4}}-\d{{2}}|{NO_MONTH}|{_OLD_NO_MONTH})"
_OWN: Final = re.compile(
    "|".join(
        f"{table.name}/{_MONTH}/{_PART}" if table.by_month else f"{table.name}/{_PART}"
        for table in TABLES.values()
    )
)
"""The form of the names of a data set's files, below its folder."""


def read_manifest(folder: Place) -> Row:
    """Return the manifest: ``tables`` by name with ``rows`` and ``files``; ``outcomes`` counted.

    Raises:
        SourceError: there is no data set, or it has another format, or it cannot be read.
    """
    path = folder / MANIFEST
    try:
        found = json.loads(path.read_bytes())
        if found["format"] != FORMAT:
            raise SourceError(f"{path} has format {found['format']}, this version reads {FORMAT}")
        others = [name for name in _named(found) if _OWN.fullmatch(name) is None]
        found["generation"] + 0, dict(found["outcomes"])
    except ConfigError:  # a ValueError: a library is missing
        raise
    except (FileNotFoundError, NotADirectoryError):
        raise SourceError(f"{folder} is not a data set: it has no {MANIFEST}") from None
    except OSError as error:
        raise SourceError(f"{path} cannot be read: {error.strerror}") from error
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise SourceError(f"{path} is not a data set's manifest: {error}") from error
    if others:
        raise SourceError(f"{path} is not a data set's manifest: it names {others[0]}")
    manifest: Row = found
    return manifest


def complete(folder: Place, manifest: ReadRow) -> None:
    """Move and remove files until they are as the manifest says, wherever a kill has left them.

    Raises:
        OSError: a file cannot be removed or moved.
    """
    named = set(_named(manifest))
    for name in set(_own_files(folder)) - named:
        (folder / name).unlink(missing_ok=True)
    new = folder / NEW
    for name in set(_own_files(new)):
        if name in named:
            _move(new / name, folder / name)
        else:
            (new / name).unlink(missing_ok=True)
    if isinstance(folder, Path) and isinstance(new, Path):
        _remove_empty(folder, new)


def _move(path: Place, target: Place) -> None:
    if isinstance(path, Path) and isinstance(target, Path):
        target.parent.mkdir(parents=True, exist_ok=True)
        path.replace(target)
    elif not (isinstance(path, Path) or isinstance(target, Path)):
        path.replace(target)


def _remove_empty(folder: Path, new: Path) -> None:
    tables = [each / table for each in (folder, new) for table in TABLES]
    months = [path for table in tables for path in table.glob("month=*")]
    ours = [path for path in months if re.fullmatch(_MONTH, path.name)]
    for path in (*ours, *tables[len(TABLES) :], new):
        if path.is_dir() and not any(path.iterdir()):
            path.rmdir()


def opened(folder: Place, name: str) -> BinaryIO:
    """Open a file that a manifest names; it may still lie among the new files.

    Raises:
        OSError: the file cannot be opened.
    """
    with suppress(FileNotFoundError):
        return (folder / name).open("rb")
    with suppress(FileNotFoundError):
        return (folder / NEW / name).open("rb")
    return (folder / name).open("rb")  # it was moved to its place meanwhile


def month_of(name: str) -> str:
    """Return the month of a file that a manifest names; ``NO_MONTH`` for rows without a date."""
    month = Path(name).parent.name.removeprefix("month=")
    return NO_MONTH if month == _OLD_NO_MONTH else month


def _named(manifest: ReadRow) -> list[str]:
    return [each["path"] for table in manifest["tables"].values() for each in table["files"]]


def _own_files(folder: Place) -> Iterator[str]:
    for table in TABLES:
        if isinstance(folder, Path):
            paths = (folder / table).rglob("part-*.parquet")
            names = [path.relative_to(folder).as_posix() for path in paths]
        else:
            names = folder.below(table)
        yield from filter(_OWN.fullmatch, names)
