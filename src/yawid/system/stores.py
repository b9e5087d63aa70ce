"""Files in a store that fsspec knows (``s3://bucket/data``), by the methods of Path used on them.

A store has no locks, no half-written files, and often no folders.
"""

import errno
import os
import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, BinaryIO, Final

from yawid.errors import ConfigError, SourceError, YawidError

CHUNK: Final = 1 << 20


class StoredPath:
    """A file, or what would be a folder, in a store; where a method fails it raises OSError.

    Raises:
        ConfigError: at its first use; fsspec or the store's own library is not installed.
    """

    def __init__(self, url: str) -> None:
        self._url = url.rstrip("/")

    @cached_property
    def _found(self) -> tuple[Any, str]:
        with _os_errors(self._url):
            store, name = fsspec().core.url_to_fs(self._url)
        return store, str(name).rstrip("/")

    @property
    def _store(self) -> Any:
        return self._found[0]

    @property
    def _name(self) -> str:
        return self._found[1]

    def __str__(self) -> str:
        return self._url

    __repr__ = __str__

    def __truediv__(self, below: str) -> "StoredPath":
        return StoredPath(f"{self._url}/{below}")

    @property
    def name(self) -> str:
        """The last part of the name."""
        return self._url.rpartition("/")[2]

    @property
    def local_name(self) -> str:
        """A name for a copy in a folder of this machine, out of which no system reads a way."""
        return re.sub(r"[^\w.-]", "_", self.name) or "log"

    @property
    def stem(self) -> str:
        """The last part of the name without its suffix."""
        return Path(self.name).stem

    @property
    def parent(self) -> "StoredPath":
        """The place that it lies in."""
        return StoredPath(self._url.rpartition("/")[0])

    def absolute(self) -> "StoredPath":
        """Return itself."""
        return self

    def exists(self) -> bool:
        """Return whether there is such a file, or a file below it."""
        return bool(self._asked("exists"))

    def is_dir(self) -> bool:
        """Return whether there is a file below it."""
        return bool(self._asked("isdir"))

    def below(self, folder: str = "") -> list[str]:
        """Return the names of all files below it, or below one of its folders, relative to it."""
        place = self / folder if folder else self
        start = len(self._name) + 1
        return [str(name)[start:] for name in place._asked("find")]

    def open(self, mode: str = "rb") -> BinaryIO:
        """Open the file for reading."""
        with _os_errors(str(self)):
            stream: BinaryIO = self._store.open(self._name, mode)
        return stream

    def read_bytes(self) -> bytes:
        """Return the content of the file."""
        return bytes(self._asked("cat_file"))

    def write_bytes(self, data: bytes) -> None:
        """Put a file as a whole."""
        with _os_errors(str(self)):
            self._make_folder()
            self._store.pipe_file(self._name, data)

    def copy_to(self, local: Path) -> None:
        """Copy the file to one of this machine.

        Raises:
            SourceError: it cannot be read.
        """
        try:
            with self.open() as stream, local.open("wb") as out, _os_errors(str(self)):
                shutil.copyfileobj(stream, out, CHUNK)
        except OSError as error:
            raise SourceError(f"{self} cannot be read: {error.strerror}") from error

    def create(self, data: bytes) -> bool:
        """Put a file if there is none, and return whether this was done."""
        if self.exists():
            return False
        try:
            with _os_errors(str(self)):
                self._make_folder()
                self._store.pipe_file(self._name, data, mode="create")
        except OSError:
            if self.exists():  # not every store raises FileExistsError
                return False
            raise
        return True

    @property
    def creates_once(self) -> bool:
        """Whether of two that create this file, which must exist, only one can succeed."""
        import fsspec.spec

        if type(self._store).pipe_file is fsspec.spec.AbstractFileSystem.pipe_file and not hasattr(
            self._store, "_pipe_file"
        ):
            return False  # fsspec's own pipe_file looks first, and then writes
        before = self.read_bytes()
        try:
            self._store.pipe_file(self._name, before, mode="create")
        except Exception:
            return True
        return False

    def unlink(self, missing_ok: bool = False) -> None:
        """Remove the file."""
        try:
            self._asked("rm_file")
        except FileNotFoundError:
            if not missing_ok:
                raise

    def replace(self, target: "StoredPath") -> None:
        """Give the file another name, by a copy."""
        with _os_errors(str(self)):
            target._make_folder()
            self._store.cp_file(self._name, target._name)
        self.unlink()

    def _make_folder(self) -> None:
        if self._name.startswith("/"):  # not a store of objects: it has folders
            self._store.makedirs(self.parent._name, exist_ok=True)

    def _asked(self, method: str) -> Any:
        with _os_errors(str(self)):
            self._store.invalidate_cache()  # others write there, too
            return getattr(self._store, method)(self._name)


Place = Path | StoredPath
"""A path on this machine or in a store."""


def place_of(text: str) -> Place:
    """Return a path, or of a URL the place in its store."""
    if text.startswith("file://"):
        return Path(text.removeprefix("file://"))
    return StoredPath(text) if "://" in text else Path(text)


@contextmanager
def brought(place: Place) -> Iterator[Path]:
    """Yield a path of this machine; a file of a store is copied, and its copy is removed at last.

    Errors within the context name the file in the store.

    Raises:
        SourceError: the file cannot be read.
    """
    if isinstance(place, Path):
        yield place
        return
    with TemporaryDirectory(prefix="yawid-") as folder:
        local = Path(folder) / place.local_name
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


@contextmanager
def _os_errors(name: str) -> Iterator[None]:
    """Turn what a store's library raises into OSErrors that have a text.

    Raises:
        ConfigError: the library of this kind of store is not installed.
    """
    try:
        yield
    except YawidError:
        raise
    except ImportError as error:
        raise ConfigError(f"{name}: {error}") from error
    except OSError as error:
        by_kind = {FileNotFoundError: errno.ENOENT, FileExistsError: errno.EEXIST}
        code = by_kind.get(type(error)) or error.errno or errno.EIO
        of_code = os.strerror(code) if type(error) in by_kind else ""
        said = error.strerror or of_code or str(error) or type(error).__name__
        raise OSError(code, said, name) from error
    except Exception as error:  # a store's library may raise anything
        said = f"{type(error).__name__}: {error}"
        raise OSError(errno.EIO, said, name) from error
