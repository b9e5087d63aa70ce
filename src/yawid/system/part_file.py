"""How a file gets its final name: whoever opens a ``.part`` file owns it, renames or removes it."""

import os
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from yawid.errors import SinkError
from yawid.system.files import IS_POSIX, lock
from yawid.system.stores import Place


@contextmanager
def os_errors_as_sink_error(path: Place) -> Iterator[None]:
    """Turn an OSError about ``path`` into a SinkError of one line."""
    try:
        yield
    except PermissionError as error:
        raise SinkError(f"cannot write {path}: permission denied: choose another folder") from error
    except OSError as error:
        raise SinkError(f"cannot write {path}: {error.strerror or error}") from error


class Part:
    """A file that this process alone writes, as ``<path><suffix>`` until it is finished.

    It is locked while ``stream`` is open, so that a second run with ``force`` is refused; of a
    killed run the system drops the lock, and a run with ``force`` writes it again.

    Raises:
        SinkError: the file or its part exists and ``force`` is not set, another run writes the
        part, or it cannot be written.
    """

    def __init__(self, path: Path, *, force: bool, suffix: str = ".part") -> None:
        self._force, self._has_name = force, False
        self.place = path.with_name(path.name + suffix)
        check_free(path, force=force)
        with os_errors_as_sink_error(self.place):
            self.stream = self._opened()

    def _opened(self) -> BinaryIO:
        flags = os.O_WRONLY | os.O_CREAT | getattr(os, "O_BINARY", 0)
        while True:
            try:
                file = os.open(self.place, flags if self._force else flags | os.O_EXCL, 0o666)
            except FileExistsError as error:
                raise SinkError(
                    f"{self.place} exists, as a run is still writing it or was cut off: move it "
                    "away or use --force"
                ) from error
            stream = os.fdopen(file, "wb")
            try:
                self._lock(file)
                about = os.fstat(file)
                # Whoever had it may have renamed or removed it before it was locked here.
                with suppress(FileNotFoundError):
                    if os.path.samestat(about, self.place.stat()):
                        if about.st_size:
                            os.truncate(file, 0)
                        return stream
            except BaseException:
                stream.close()
                raise
            stream.close()

    def _lock(self, file: int) -> None:
        try:
            lock(file)
        except (BlockingIOError, PermissionError) as error:
            raise SinkError(
                f"another run is writing {self.place}: wait until it has ended, or choose another "
                "name"
            ) from error
        except OSError:
            pass  # a file system without locks

    def take_name(self, path: Path) -> None:
        """Give the file, of which everything is written, its final name.

        Raises:
            SinkError: another file has got that name meanwhile and ``force`` is not set, or
            renaming fails.
        """
        check_free(path, force=self._force)
        with os_errors_as_sink_error(path):
            if not IS_POSIX:
                self.stream.close()
            self.place.replace(path)
            self._has_name = True
            self.stream.close()  # no other run could lock it before

    def remove(self) -> None:
        """Remove the file, unless it has its name."""
        if self._has_name:
            return
        if not IS_POSIX:
            self.leave()
        with suppress(OSError):
            self.place.unlink(missing_ok=True)
        self.leave()

    def leave(self) -> None:
        """Close the file under its unfinished name."""
        with suppress(OSError):  # the failure to write has been reported already
            self.stream.close()


def check_free(path: Path, *, force: bool) -> None:
    """Check that a file may get this name.

    Raises:
        SinkError: a folder has it, or a file has it and ``force`` is not set.
    """
    if path.is_dir():
        raise SinkError(f"cannot write {path}: it is a folder")
    if path.exists() and not force:
        raise SinkError(f"{path} exists: --force overwrites it")


def write_whole(files: Mapping[Path, bytes], *, force: bool = False) -> None:
    """Write all files under ``.part`` names, then rename each: all are written whole, or none is.

    Raises:
        SinkError: one exists and ``force`` is not set, or one cannot be written.
    """
    with ExitStack() as stack:
        for path, data in files.items():
            stream = stack.enter_context(written_whole(path, force=force))
            with os_errors_as_sink_error(path):
                stream.write(data)
                sync(stream)


@contextmanager
def written_whole(path: Path, *, force: bool = False, suffix: str = ".part") -> Iterator[BinaryIO]:
    """Open a file to be written piece by piece; it gets its name at the end, an error removes it.

    Raises:
        SinkError: it exists and ``force`` is not set, or it cannot be written.
    """
    part = Part(path, force=force, suffix=suffix)
    try:
        with os_errors_as_sink_error(path):
            yield part.stream
            sync(part.stream)
        part.take_name(path)
    finally:
        part.remove()


class Disk:
    """A disk that is synchronised at once, while the writer waits; a subclass may do it later."""

    def sync_soon(self, stream: BinaryIO) -> None:
        """Hand what was written to the operating system at once, and have it on the disk soon.

        Raises:
            OSError: writing failed, now or after the last call.
        """
        sync(stream)

    def sync_now(self, stream: BinaryIO) -> None:
        """Return when everything written is on the disk.

        Raises:
            OSError: as :meth:`sync_soon`.
        """
        sync(stream)


def sync(stream: BinaryIO) -> None:
    """Write the buffers of ``stream`` and of the operating system to the disk."""
    stream.flush()
    os.fsync(stream.fileno())
