"""Where the files of a data set lie, and which files in its folder are its own.

Only a manifest makes a folder a data set, and only files with names of our own form are removed:
whatever else lies there stays as it is.
"""

import json
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

from yawid.dataset.schema import FORMAT, TABLES
from yawid.errors import SourceError

MANIFEST: Final = "manifest.json"
_PART: Final = r"part-\d{6,}-\d+\.parquet"
_MONTH: Final = r"month=(\d{4}-\d{2}|__HIVE_DEFAULT_PARTITION__)"
_OWN: Final = re.compile(
    "|".join(
        f"{table.name}/{_MONTH}/{_PART}" if table.by_month else f"{table.name}/{_PART}"
        for table in TABLES.values()
    )
)
"""Names of our own form, below the data set's folder."""


def read_manifest(folder: Path) -> dict[str, Any]:
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
    manifest: dict[str, Any] = found
    return manifest


def sweep(folder: Path, manifest: Mapping[str, Any]) -> None:
    """Remove the files of a data set that its manifest does not name: a run was killed."""
    named = set(_named(manifest))
    for name in set(_own_files(folder)) - named:
        path = folder / name
        path.unlink(missing_ok=True)
        if path.parent.parent != folder and not any(path.parent.iterdir()):
            path.parent.rmdir()


def _named(manifest: Mapping[str, Any]) -> list[str]:
    return [each["path"] for table in manifest["tables"].values() for each in table["files"]]


def _own_files(folder: Path) -> Iterator[str]:
    for table in TABLES:
        for path in (folder / table).rglob("part-*.parquet"):
            name = path.relative_to(folder).as_posix()
            if _OWN.fullmatch(name):
                yield name
