"""Finds the logs below paths, globs and URLs, and what shows that a log has changed."""

import glob
import os
import stat
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
    """The absolute path or the URL, with backslash codes for what no table can hold."""
    size: int
    """The size in bytes."""
    modified: str
    """The time of the last change in ns since 1970, or what a store reports instead (an ETag)."""
    failure: str | None = None
    """Why it is not read, where only its name makes it a log."""


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
    for folder in {os.path.dirname(_local_path(log.path)) for log in found}:
        if folder and Path(os.path.realpath(folder)).is_relative_to(place):
            raise ConfigError(
                f"--out {out} holds the logs in {folder}: a data set needs a folder of its own: "
                "choose one that holds no logs"
            )
    for path in paths:
        searched = _searched(_local_path(path))
        if searched is not None and place.is_relative_to(os.path.realpath(searched)):
            raise ConfigError(
                f"--out {out} lies below {searched}, where logs are searched for: choose a folder "
                "outside of it"
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
    lower = name.lower()
    return lower.endswith(ends) and not lower.endswith(NOT_FINISHED)


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
    except OSError as error:
        return _named(whole, 0, "unknown", f"it cannot be read: {error.strerror}")
    what = None if stat.S_ISREG(about.st_mode) else "it is not a regular file: only those are read"
    return _named(whole, about.st_size, str(about.st_mtime_ns), what)


def _named(path: str, size: int, modified: str, failure: str | None = None) -> FoundLog:
    """Return a log found; the tables hold UTF-8, so that one with another name is not read."""
    text = path.encode("utf-8", "backslashreplace").decode()
    if text != path:
        failure = failure or "its name is not UTF-8: rename the file or its folder"
    return FoundLog(text, size, modified, failure)


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
                yield _named(store.unstrip_protocol(name), size, _modified(about))
    except Exception as error:  # a store's library may raise anything
        raise SourceError(f"{url}: {type(error).__name__}: {error}") from error


def _modified(about: Any) -> str:
    """Return what a store reports as a file's state: its ETag, else a hash or a time."""
    names = ("ETag", "etag", "md5Hash", "mtime", "LastModified", "last_modified", "created")
    return str(next((about[name] for name in names if about.get(name)), "unknown"))
