"""Finds the logs below paths, globs and URLs, and what shows that a log has changed."""

import glob
import os
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from yawid.errors import ConfigError, SourceError
from yawid.sources.formats import IN_FOLDERS, WITH_RECORDS
from yawid.system.stores import fsspec

NOT_FINISHED: Final = ".interrupted.mcap"
_WILD: Final = frozenset("*?[")


@dataclass(frozen=True, slots=True)
class FoundLog:
    """A log file: where it is, and its size and state when it was found."""

    path: str
    """The absolute path or the URL."""
    size: int
    """The size in bytes, 0 where it cannot be read."""
    modified: str
    """The time of the last change in ns since 1970, or what a store reports instead (an ETag)."""


def find_logs(paths: Iterable[str], *, with_records: bool = False) -> list[FoundLog]:
    """Return every log below the given files, folders, globs and URLs, once each, largest first.

    CSV and Parquet files, which have many other uses, are found only ``with_records``.

    Raises:
        SourceError: one of ``paths`` has no log, or cannot be listed.
        ConfigError: a URL is given and fsspec is not installed.
    """
    found: dict[str, FoundLog] = {}
    ends = WITH_RECORDS if with_records else IN_FOLDERS
    for path in paths:
        logs = _below_url(path, ends) if "://" in path else _below(path, ends)
        below = {each.path: each for each in logs}
        if not below:
            columns = (
                "" if with_records else "; for CSV and Parquet give --rudder-unit or --columns"
            )
            raise SourceError(
                f"{path}: no log was found there; the names of logs end in {', '.join(ends)}"
                f"{columns}"
            )
        found |= below
    return sorted(found.values(), key=lambda log: (-log.size, log.path))


def check_apart(paths: Iterable[str], found: Iterable[FoundLog], out: Path) -> None:
    """Check that the data set's folder ``out`` and the folders of the logs are separate.

    Raises:
        ConfigError: one of them contains the other.
    """
    place = Path(os.path.realpath(out))
    holding = {os.path.dirname(_local_path(log.path)) for log in found}
    apart = [(Path(os.path.realpath(folder)), place) for folder in holding if folder]
    searched = filter(None, (_searched(_local_path(path)) for path in paths))
    apart += [(place, Path(os.path.realpath(folder))) for folder in searched]
    for inner, outer in apart:
        if inner.is_relative_to(outer):
            raise ConfigError(
                f"--out {out} and the logs are not apart, as {inner} lies in {outer}: choose a "
                "folder that neither holds logs nor is searched for them"
            )


def _local_path(path: str) -> str:
    """Return a path of this machine without ``file://``, and "" for a URL of another store."""
    path = path.removeprefix("file://")
    return "" if "://" in path else path


def _searched(path: str) -> str | None:
    """Return the folder that is searched recursively, or None if ``path`` does not name one."""
    before, wild, _ = path.partition("**")
    if wild and not _WILD & set(before):
        return os.path.dirname(before) or "."
    return path if path and os.path.isdir(path) else None


def is_log(name: str, ends: tuple[str, ...]) -> bool:
    """Return whether a file found in a folder is a log by its name, which has one of these ends.

    A file that the user names is always taken for a log.
    """
    return name.lower().endswith(ends) and not name.lower().endswith(NOT_FINISHED)


def _below(path: str, ends: tuple[str, ...]) -> Iterator[FoundLog]:
    if os.path.isdir(path):
        for folder, _, names in os.walk(path, onerror=_cannot_list):
            yield from (_local(os.path.join(folder, name)) for name in names if is_log(name, ends))
    elif os.path.lexists(path):
        yield _local(path)
    elif _WILD & set(path):
        for each in glob.iglob(path, recursive=True):
            if is_log(each, ends) and not os.path.isdir(each):
                yield _local(each)
    else:
        raise SourceError(f"{path}: no such file or folder")


def _local(path: str) -> FoundLog:
    whole = os.path.abspath(path)
    try:
        about = os.stat(path)
    except OSError:  # who reads it says why it cannot be read
        return FoundLog(whole, 0, "unknown")
    return FoundLog(whole, about.st_size, str(about.st_mtime_ns))


def _cannot_list(error: OSError) -> None:
    raise SourceError(f"{error.filename}: {error.strerror}") from error


def _below_url(url: str, ends: tuple[str, ...]) -> Iterator[FoundLog]:
    core = fsspec().core
    try:
        store, root = core.url_to_fs(url)
        if _WILD & set(root):
            names = store.glob(root, detail=True)
        else:
            names = store.find(root, detail=True)
            if isinstance(names, list):  # adlfs, of a file
                names = {each: store.info(each) for each in names}
        for name, about in names.items():
            if name == root or (about.get("type") == "file" and is_log(name, ends)):
                size = int(about.get("size") or 0)
                yield FoundLog(store.unstrip_protocol(name), size, _modified(about))
    except Exception as error:  # a store's library may raise anything
        raise SourceError(f"{url}: {type(error).__name__}: {error}") from error


def _modified(about: Any) -> str:
    """Return what a store reports as a file's state: its ETag, else a hash or a time."""
    names = ("ETag", "etag", "md5Hash", "mtime", "LastModified", "last_modified", "created")
    return str(next((about[name] for name in names if about.get(name)), "unknown"))
