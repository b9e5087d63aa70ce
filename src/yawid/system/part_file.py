"""How a file gets its final name: whoever opens a ``.part`` file owns it, renames or removes it."""

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from yawid.errors import SinkError
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


def open_part(path: Path, *, force: bool, suffix: str = ".part") -> tuple[Path, BinaryIO]:
    """Open ``<path><suffix>``, the name that a file has until it is finished.

    Raises:
        SinkError: the file or its part exists and ``force`` is not set, or it cannot be written.
    """
    part = path.with_name(path.name + suffix)
    check_free(path, force=force)
    with os_errors_as_sink_error(part):
        try:
            return part, part.open("wb" if force else "xb")
        except FileExistsError as error:
            raise SinkError(
                f"{part} exists, as a run is still writing it or was cut off: move it away or use "
                "--force"
            ) from error


def check_free(path: Path, *, force: bool) -> None:
    """Check that a file may get this name.

    Raises:
        SinkError: a folder has it, or a file has it and ``force`` is not set.
    """
    if path.is_dir():
        raise SinkError(f"cannot write {path}: it is a folder")
    if path.exists() and not force:
        raise SinkError(f"{path} exists: --force overwrites it")


def take_name(part: Path, path: Path, *, force: bool) -> None:
    """Give a finished file its final name.

    Raises:
        SinkError: another file has got that name meanwhile and ``force`` is not set, or renaming
        fails.
    """
    check_free(path, force=force)
    with os_errors_as_sink_error(path):
        part.replace(path)


def write_whole(files: Mapping[Path, bytes], *, force: bool = False) -> None:
    """Write all files under ``.part`` names, then rename each: all are written whole, or none is.

    Raises:
        SinkError: one exists and ``force`` is not set, or one cannot be written.
    """
    parts: dict[Path, Path] = {}
    try:
        for path, data in files.items():
            parts[path], stream = open_part(path, force=force)
            with stream, os_errors_as_sink_error(path):
                stream.write(data)
                sync(stream)
        for path in parts:
            check_free(path, force=force)
        for path, part in parts.items():
            take_name(part, path, force=force)
    finally:
        for part in parts.values():
            part.unlink(missing_ok=True)


@contextmanager
def written_whole(path: Path, *, force: bool = False, suffix: str = ".part") -> Iterator[BinaryIO]:
    """Open a file to be written piece by piece; it gets its name at the end, an error removes it.

    Raises:
        SinkError: it exists and ``force`` is not set, or it cannot be written.
    """
    part, stream = open_part(path, force=force, suffix=suffix)
    try:
        with os_errors_as_sink_error(path), stream:
            yield stream
            sync(stream)
        take_name(part, path, force=force)
    finally:
        part.unlink(missing_ok=True)


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
