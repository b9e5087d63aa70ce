"""Files in a store that fsspec knows (``s3://bucket/flight.BIN``), which are read there."""

import errno
import os
import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

from yawid.errors import ConfigError, SourceError, YawidError

CHUNK: Final = 1 << 20


class StoredPath:
    """A file in a store, with the names that a Path has.

    ``local_name`` is one for a copy in a folder of this machine, out of which no system reads a
    way.
    """

    def __init__(self, url: str) -> None:
        self._url = url.rstrip("/")
        self.name = self._url.rpartition("/")[2]
        self.stem = Path(self.name).stem
        self.local_name = re.sub(r"[^\w.-]", "_", self.name) or "log"

    def __str__(self) -> str:
        return self._url

    __repr__ = __str__

    def absolute(self) -> "StoredPath":
        """Return itself."""
        return self

    def copy_to(self, local: Path) -> None:
        """Copy the file to one of this machine.

        Raises:
            ConfigError: fsspec or the store's own library is not installed.
            SourceError: it cannot be read.
        """
        try:
            with fsspec().open(self._url) as stream, local.open("wb") as out:
                shutil.copyfileobj(stream, out, CHUNK)
        except YawidError:
            raise
        except ImportError as error:
            raise ConfigError(f"{self}: {error}") from error
        except Exception as error:  # a store's library may raise anything
            number = getattr(error, "errno", None)
            number = errno.ENOENT if isinstance(error, FileNotFoundError) else number
            said = os.strerror(number) if number else f"{type(error).__name__}: {error}"
            raise SourceError(f"{self} cannot be read: {said}") from error


Place = Path | StoredPath
"""A path on this machine or in a store."""


def place_of(text: str) -> Place:
    """Return a path, or of a URL the place in its store."""
    if text.startswith("file://"):
        return Path(text.removeprefix("file://"))
    return StoredPath(text) if "://" in text else Path(text)


@contextmanager
def brought(place: Place, folder: Path | None = None) -> Iterator[Path]:
    """Yield a path of this machine; a file of a store is copied, and its copy is removed at last.

    Copies are below ``folder``, else where the system has its temporary files.

    Errors within the context name the file in the store.

    Raises:
        SourceError: the file cannot be read.
    """
    if isinstance(place, Path):
        yield place
        return
    with TemporaryDirectory(prefix="yawid-", dir=folder) as own:
        local = Path(own) / place.local_name
        place.copy_to(local)
        try:
            yield local
        except YawidError as error:
            raise type(error)(str(error).replace(str(local), str(place))) from error


def fsspec() -> Any:
    """Return fsspec, which is optional.

    Raises:
        ConfigError: it is not installed.
    """
    try:
        import fsspec.core
    except ImportError as error:
        raise ConfigError("URLs need fsspec: pip install 'yawid[fleet]'") from error
    return fsspec
