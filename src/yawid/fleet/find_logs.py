"""Which logs there are below paths, globs and URLs, and what tells whether one has changed."""

import glob
import hashlib
import os
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from yawid.errors import ConfigError, SourceError
from yawid.sources.formats import IN_FOLDERS

NOT_FINISHED: Final = ".interrupted.mcap"
_WILD: Final = frozenset("*?[")
_CHUNK: Final = 1 << 20


@dataclass(frozen=True, slots=True)
class FoundLog:
    """A log: absolute path or URL, bytes, and its ETag or its time in ns since 1970."""

    path: str
    size: int
    modified: str


def find_logs(paths: Iterable[str]) -> list[FoundLog]:
    """Return every log below files, folders, globs and URLs, once each, the largest first.

    Raises:
        SourceError: below one of them is none, or it cannot be listed.
        ConfigError: a URL is given and fsspec is not installed.
    """
    found: dict[str, FoundLog] = {}
    for path in paths:
        below = {each.path: each for each in (_below_url(path) if "://" in path else _below(path))}
        if not below:
            raise SourceError(f"{path}: no log there; logs end in {', '.join(IN_FOLDERS)}")
        found |= below
    return sorted(found.values(), key=lambda log: (-log.size, log.path))


def check_apart(paths: Iterable[str], found: Iterable[FoundLog], out: Path) -> None:
    """Find out whether a data set's folder and those of the logs are apart.

    Raises:
        ConfigError: one of them holds the other.
    """
    place = Path(os.path.realpath(out))
    for folder in {os.path.dirname(_local_path(log.path)) for log in found}:
        if folder and Path(os.path.realpath(folder)).is_relative_to(place):
            raise ConfigError(
                f"--out {out} holds the logs in {folder}: a data set needs a folder of its own, "
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
    """Return a path of this machine; "" of what lies elsewhere."""
    path = path.removeprefix("file://")
    return "" if "://" in path else path


def _searched(path: str) -> str | None:
    """Return the folder that is searched with all that is below it; None where there is none."""
    before, wild, _ = path.partition("**")
    if wild and not _WILD & set(before):
        return os.path.dirname(before) or "."
    return path if path and os.path.isdir(path) else None


def is_log(name: str) -> bool:
    """Tell by its name whether a file of a folder is a log; one that is named always is."""
    lower = name.lower()
    return lower.endswith(IN_FOLDERS) and not lower.endswith(NOT_FINISHED)


def sha256_of(log: FoundLog) -> str:
    """Return the hash of a log's bytes.

    Raises:
        SourceError: it cannot be read.
    """
    try:
        if "://" not in log.path:
            with Path(log.path).open("rb") as stream:
                return hashlib.file_digest(stream, "sha256").hexdigest()
        digest = hashlib.sha256()
        with _fsspec().open(log.path, "rb") as stream:
            while chunk := stream.read(_CHUNK):
                digest.update(chunk)
        return digest.hexdigest()
    except Exception as error:  # whatever a store's library raises
        raise SourceError(f"{log.path}: {error}") from error


def own_bytes(log: FoundLog) -> bytes | None:
    """Return the bytes of a log that no other process sees: one in ``memory://``."""
    if not log.path.startswith("memory://"):
        return None
    with _fsspec().open(log.path, "rb") as stream:
        data: bytes = stream.read()
        return data


def _below(path: str) -> Iterator[FoundLog]:
    if os.path.isfile(path):
        yield _local(path)
    elif os.path.isdir(path):
        for folder, _, names in os.walk(path, onerror=_cannot_list):
            yield from (_local(os.path.join(folder, name)) for name in names if is_log(name))
    elif _WILD & set(path):
        for each in glob.iglob(path, recursive=True):
            if is_log(each) and os.path.isfile(each):
                yield _local(each)
    else:
        raise SourceError(f"{path}: no such file or folder")


def _local(path: str) -> FoundLog:
    try:
        about = os.stat(path)
    except OSError as error:
        raise SourceError(f"{path}: {error.strerror}") from error
    return FoundLog(os.path.abspath(path), about.st_size, str(about.st_mtime_ns))


def _cannot_list(error: OSError) -> None:
    raise SourceError(f"{error.filename}: {error.strerror}") from error


def _below_url(url: str) -> Iterator[FoundLog]:
    fsspec = _fsspec()
    try:
        store, root = fsspec.core.url_to_fs(url)
        if _WILD & set(root):
            names = store.glob(root, detail=True)
        else:
            names = store.find(root, detail=True)
        for name, about in names.items():
            if name == root or (about.get("type") == "file" and is_log(name)):
                size = int(about.get("size") or 0)
                yield FoundLog(store.unstrip_protocol(name), size, _modified(about))
    except Exception as error:  # whatever a store's library raises
        raise SourceError(f"{url}: {type(error).__name__}: {error}") from error


def _modified(about: Any) -> str:
    """Return what a store tells of a file's state: its ETag where there is one."""
    names = ("ETag", "etag", "md5Hash", "mtime", "LastModified", "last_modified", "created")
    return str(next((about[name] for name in names if about.get(name)), "unknown"))


def _fsspec() -> Any:
    try:
        import fsspec.core
    except ImportError as error:
        raise ConfigError("URLs need fsspec: pip install 'yawid[fleet]'") from error
    return fsspec
