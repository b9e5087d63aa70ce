"""One way to read every kind of log: open it, then take blocks of messages from it.

A log is known by its first bytes, never by its name: dataflash, ULog, and a telemetry log else.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Protocol

from yawid.blocks import FrameBlock
from yawid.sources.logs.dataflash import DataflashReader
from yawid.sources.logs.dataflash_index import MAGIC as DATAFLASH
from yawid.sources.logs.tlog import Digest, Form, check_readable, read_tlog
from yawid.sources.logs.ulog import MAGIC as ULOG
from yawid.sources.logs.ulog import UlogReader
from yawid.sources.mavlink.decoder import Decoder
from yawid.sources.mavlink.link_stats import LinkStats

SUFFIXES = (".tlog", ".bin", ".ulg")
"""What logs are called, by their kind: telemetry, dataflash, ULog."""


class LogReader(Protocol):
    """A log opened for reading."""

    @property
    def link(self) -> LinkStats:
        """Counts of what the log holds; of a telemetry log, of what has been read so far."""

    def read(self, digest: Digest | None = None) -> Iterator[tuple[int, FrameBlock | None]]:
        """Yield (bytes read, the messages they hold), continuing ``digest`` by the bytes."""


class TlogReader:
    """A telemetry log, read through a decoder; its owner calls ``finish`` after the last piece.

    Raises:
        SourceError: as :func:`yawid.sources.logs.tlog.check_readable`.
    """

    def __init__(self, path: Path, decoder: Decoder, form: Form = "auto") -> None:
        check_readable(path, form)
        self._path = path
        self._decoder = decoder
        self._form = form

    @property
    def link(self) -> LinkStats:
        """Counts of all that has been decided so far."""
        return self._decoder.link

    def read(self, digest: Digest | None = None) -> Iterator[tuple[int, FrameBlock | None]]:
        """Yield (bytes read, the messages they completed), continuing ``digest`` by the bytes."""
        for chunk in read_tlog(self._path, digest=digest, form=self._form):
            yield len(chunk), self._decoder.feed(chunk)


def open_log(path: Path, decoder: Decoder, form: Form = "auto") -> LogReader:
    """Return the reader of a log; a telemetry log of this ``form`` is read by ``decoder``.

    A dataflash log or a ULog gives the messages that the channels can use.

    Raises:
        SourceError: there is no such file, it cannot be read, or it is no log.
    """
    head = _head(path) if form == "auto" else b""
    if head.startswith(DATAFLASH):
        return DataflashReader(path)
    if head.startswith(ULOG):
        return UlogReader(path)
    return TlogReader(path, decoder, form)


def log_suffix(path: Path) -> str:
    """Return the one of ``SUFFIXES`` that names the kind of a log."""
    head = _head(path)
    return SUFFIXES[1 if head.startswith(DATAFLASH) else 2 if head.startswith(ULOG) else 0]


def _head(path: Path) -> bytes:
    """Return the first bytes, none where the telemetry log's reader is to say what is wrong."""
    if not path.is_file():
        return b""
    try:
        with path.open("rb") as file:
            return file.read(len(ULOG))
    except OSError:
        return b""
