"""One way to read every kind of log: open it, then take blocks of messages from it, again and again.

A log is known by its first bytes, never by its name: dataflash, ULog, and a telemetry log else.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Protocol

from yawid.blocks import FrameBlock
from yawid.sources.dataflash import DataflashReader
from yawid.sources.dataflash_index import MAGIC as DATAFLASH
from yawid.sources.frames import Decoder
from yawid.sources.link import LinkStats
from yawid.sources.tlog import Digest, check_readable, read_tlog
from yawid.sources.ulog import MAGIC as ULOG
from yawid.sources.ulog import UlogReader


class LogReader(Protocol):
    """A log opened for reading."""

    @property
    def link(self) -> LinkStats:
        """Counts of what has been read so far."""

    def read(self, digest: Digest | None = None) -> Iterator[tuple[int, FrameBlock | None]]:
        """Yield (bytes read, the messages they completed) from the start, continuing ``digest``."""


class TlogReader:
    """A telemetry log.

    Raises:
        SourceError: as :func:`yawid.sources.tlog.check_readable`.
    """

    def __init__(self, path: Path, wanted: Iterable[str]) -> None:
        check_readable(path)
        self._path = path
        self._wanted = frozenset(wanted)
        self._decoder = Decoder(self._wanted)

    @property
    def link(self) -> LinkStats:
        """Counts of all that has been decided so far."""
        return self._decoder.link

    def read(self, digest: Digest | None = None) -> Iterator[tuple[int, FrameBlock | None]]:
        """Yield (bytes read, the messages they completed) from the start, continuing ``digest``."""
        self._decoder = Decoder(self._wanted)
        for chunk in read_tlog(self._path, digest=digest):
            yield len(chunk), self._decoder.feed(chunk)
        yield 0, self._decoder.finish()


def open_log(path: Path, wanted: Iterable[str]) -> LogReader:
    """Return the reader of a log; of a telemetry log it decodes the messages ``wanted``.

    A dataflash log or a ULog gives what the channels can use, whatever is wanted.

    Raises:
        SourceError: there is no such file, it cannot be read, or it is no log.
    """
    head = _head(path)
    if head.startswith(DATAFLASH):
        return DataflashReader(path)
    if head.startswith(ULOG):
        return UlogReader(path)
    return TlogReader(path, wanted)


def _head(path: Path) -> bytes:
    """Return the first bytes, none where the telemetry log's reader is to say what is wrong."""
    if not path.is_file():
        return b""
    try:
        with path.open("rb") as file:
            return file.read(len(ULOG))
    except OSError:
        return b""
