"""One way to read every kind of log: open it, then take blocks of messages from it.

A log is known by its first bytes, never by its name: dataflash, ULog, Parquet, a table of texts,
and a telemetry log else. What is called .csv or .parquet is told why it is none.
"""

import hashlib
import pickle
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from tempfile import SpooledTemporaryFile
from typing import TYPE_CHECKING, Protocol

from yawid.blocks import FrameBlock, RecordBlock, SampleBlock
from yawid.errors import ConfigError
from yawid.sources.logs.dataflash import DataflashReader
from yawid.sources.logs.dataflash_index import MAGIC as DATAFLASH
from yawid.sources.logs.tlog import FORMS, Digest, Form, check_readable, read_tlog
from yawid.sources.logs.ulog import MAGIC as ULOG
from yawid.sources.logs.ulog import UlogReader
from yawid.sources.mavlink.decoder import Decoder
from yawid.sources.mavlink.link_stats import LinkStats
from yawid.sources.mavlink.signing import Signing, SigningKey

if TYPE_CHECKING:
    from yawid.sources.records.record import Record

SUFFIXES = (".tlog", ".bin", ".ulg")
"""What logs are called, by their kind: telemetry, dataflash, ULog."""
RECORDS = (".csv", ".parquet")
HEAD = 1 << 14
"""Bytes by which a file's kind is known."""
IN_MEMORY = 64 << 20
"""Bytes of decoded messages kept in memory; what is more goes to a file of its own."""


@dataclass(frozen=True, slots=True)
class ReadOptions:
    """The form of a log, and the key that frames must be signed with (None: any frame will do).

    ``key_file`` is where the key came from, to be named in a command line.

    It stands beside ``RunConfig``, not in it: the configuration goes into files, a key must not.
    """

    form: Form = "auto"
    key: SigningKey | None = None
    key_file: Path | None = None

    @classmethod
    def asked(cls, form: str, key_file: Path | None) -> "ReadOptions":
        """Return what options ask for: the form, and the key that a file holds.

        Raises:
            ConfigError: there is no such form, or the key cannot be read.
        """
        found = next((each for each in FORMS if each == form), None)
        if found is None:
            raise ConfigError(f"--format must be one of {', '.join(FORMS)}, got {form!r}")
        return cls(found, None if key_file is None else SigningKey.from_file(key_file), key_file)

    def decoder(self, wanted: Iterable[str]) -> Decoder:
        """Return a decoder for one stream."""
        return Decoder(wanted, None if self.key is None else Signing(self.key))

    def unchecked(self, link: LinkStats) -> str | None:
        """Return what is to be said of signed frames whose signatures nobody looked at, if any."""
        if self.key is not None or not link.signed:
            return None
        return "signed frames are read without a look at their signatures: --signing-key-file FILE"


class Source(Protocol):
    """Something recorded, opened for reading: messages of a log, or the samples of a run."""

    @property
    def size(self) -> int:
        """Bytes of the file."""

    def read(self) -> Iterator[tuple[int, FrameBlock | RecordBlock | SampleBlock | None]]:
        """Yield (bytes read, what they hold) from the start, what was held back at the end too."""


class TlogReader:
    """A telemetry log, read through a decoder.

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

    def read(self, digest: Digest) -> Iterator[tuple[int, FrameBlock | None]]:
        """Yield (bytes read, the messages they completed), continuing ``digest`` by the bytes."""
        for chunk in read_tlog(self._path, digest=digest, form=self._form):
            yield len(chunk), self._decoder.feed(chunk)
        yield 0, self._decoder.finish()


class Log:
    """A log opened for reading: the ``wanted`` messages, their counts and the file's hash.

    ``record`` is what never was MAVLink, to be settled before it is read; None of all else.

    It is decoded once. With ``again`` its messages are kept for whoever reads it again, those
    beyond ``IN_MEMORY`` in a temporary file, until ``close``.

    Raises:
        SourceError: there is no such file, it cannot be read, or it is no log.
    """

    def __init__(
        self,
        path: Path,
        wanted: Iterable[str],
        options: ReadOptions | None = None,
        *,
        again: bool = False,
    ) -> None:
        self.options = options or ReadOptions()
        self.record: Record | None = None
        self._reader = self._open(path, wanted)
        self.path, self.size = path, path.stat().st_size
        self._digest = hashlib.sha256()
        self._kept = SpooledTemporaryFile(IN_MEMORY) if again else None  # noqa: SIM115 until the end
        self._is_decoded = False

    def _open(
        self, path: Path, wanted: Iterable[str]
    ) -> "TlogReader | DataflashReader | UlogReader | Record":
        head = _head(path) if self.options.form == "auto" else b""
        if head.startswith(DATAFLASH):
            return DataflashReader(path)
        if head.startswith(ULOG):
            return UlogReader(path)
        if self.options.form == "auto" and _may_be_record(path, head):
            from yawid.sources.records.record import Record, is_record  # a log needs nothing of it

            if path.suffix.lower() in RECORDS or is_record(head):
                self.record = Record(path)
                return self.record
        return TlogReader(path, self.options.decoder(wanted), self.options.form)

    def close(self) -> None:
        """Remove what was kept, if anything was."""
        if self._kept is not None:
            self._kept.close()

    @property
    def link(self) -> LinkStats:
        """Counts of what the log holds, once it has been read."""
        return self._reader.link

    @property
    def vehicle_id(self) -> str | None:
        """What the log itself calls its vehicle, None where it does not."""
        return self._reader.vehicle_id if isinstance(self._reader, UlogReader) else None

    @property
    def sha256(self) -> str:
        """The hash of the file's bytes, once it has been read."""
        return self._digest.hexdigest()

    def read(self) -> Iterator[tuple[int, FrameBlock | RecordBlock | None]]:
        """See :class:`Source`."""
        if self._is_decoded:
            assert self._kept is not None, "a log is decoded once"
            self._kept.seek(0)
            while (piece := pickle.load(self._kept)) is not None:
                yield piece
            return
        for piece in self._reader.read(self._digest):
            if self._kept is not None:
                pickle.dump(piece, self._kept, pickle.HIGHEST_PROTOCOL)
            yield piece
        self._is_decoded = True
        if self._kept is not None:
            pickle.dump(None, self._kept)


class TlogBytes:
    """The bytes of a telemetry log in memory, in pieces cut anywhere, as a source."""

    def __init__(
        self, pieces: Iterable[bytes], wanted: Iterable[str], options: ReadOptions | None = None
    ) -> None:
        self._pieces = list(pieces)
        self._decoder = (options or ReadOptions()).decoder(wanted)
        self.size = sum(map(len, self._pieces))

    @property
    def link(self) -> LinkStats:
        """Counts of what has been read."""
        return self._decoder.link

    def read(self) -> Iterator[tuple[int, FrameBlock | None]]:
        """See :class:`Source`."""
        for piece in self._pieces:
            yield len(piece), self._decoder.feed(piece)
        yield 0, self._decoder.finish()


def log_suffix(path: Path) -> str:
    """Return the one of ``SUFFIXES`` that names the kind of a log."""
    head = _head(path)
    return SUFFIXES[1 if head.startswith(DATAFLASH) else 2 if head.startswith(ULOG) else 0]


def _may_be_record(path: Path, head: bytes) -> bool:
    """Tell if a file may be a record: a stamp begins with 0, a frame of MAVLink 2 with 0xFD."""
    return path.is_file() and head[:1] not in (b"\0", b"\xfd")


def _head(path: Path) -> bytes:
    """Return the first bytes, none where the telemetry log's reader is to say what is wrong."""
    if not path.is_file():
        return b""
    try:
        with path.open("rb") as file:
            return file.read(HEAD)
    except OSError:
        return b""
