"""The one way to read every kind of log that ``formats.py`` lists, in blocks of messages."""

import hashlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias, cast

from yawid.blocks import FrameBlock, RecordBlock
from yawid.errors import SourceError
from yawid.quantities.link import LinkStats
from yawid.sources.formats import format_of
from yawid.sources.logs.tlog import TlogReader
from yawid.sources.mavlink.decoder import Decoder
from yawid.sources.mavlink.signing import Signing, SigningKey
from yawid.system.stores import Place

if TYPE_CHECKING:
    from yawid.sources.records.record import Record


@dataclass(frozen=True, slots=True)
class ReadOptions:
    """The key that frames must be signed with (None accepts any frame), and the file it is from.

    The key is kept out of ``RunConfig``, because configurations are written into files; the file is
    kept to be named in a command line.
    """

    key: SigningKey | None = None
    key_file: Path | None = None

    @classmethod
    def asked(cls, key_file: Path | None) -> "ReadOptions":
        """Return the options with the key in a file.

        Raises:
            ConfigError: the key cannot be read.
        """
        return cls(None if key_file is None else SigningKey.from_file(key_file), key_file)

    def decoder(self, wanted: Iterable[str]) -> Decoder:
        """Return a decoder of the ``wanted`` messages for one stream."""
        return Decoder(wanted, None if self.key is None else Signing(self.key))

    def unchecked(self, link: LinkStats) -> str | None:
        """Return a note on signed frames whose signatures were not checked, None without any."""
        if self.key is not None or not link.signed:
            return None
        return "signatures were not checked: give --signing-key-file FILE to check them"


class Log:
    """A log opened for reading: the ``wanted`` messages, their counts and the file's hash.

    It is read once.

    Raises:
        SourceError: there is no such file, it cannot be read, or it is no log.
    """

    def __init__(
        self, path: Path, wanted: Iterable[str], options: ReadOptions | None = None
    ) -> None:
        self.options = options or ReadOptions()
        self.format = format_of(path)
        if self.format.opener is None:
            raise SourceError(
                f"{path} is {self.format.called}, not a telemetry log: give the .tlog of the flight"
            )
        self._reader = self.format.opener(path, partial(self.options.decoder, wanted))
        self._file = path
        self.path: Place = path  # or where the file was brought from
        self.size = path.stat().st_size
        self._digest = hashlib.sha256()

    @property
    def link(self) -> LinkStats:
        """The counts of what the log holds, once it has been read."""
        return self._reader.link

    @property
    def vehicle_id(self) -> str | None:
        """The log's own identifier of its vehicle, None where it has none."""
        return self._reader.vehicle_id

    @property
    def record(self) -> "Record | None":
        """The record, whose columns must be settled before it is read; None for MAVLink logs."""
        return cast("Record", self._reader) if self.format.has_columns else None

    @property
    def sha256(self) -> str:
        """The hash of the file's bytes, once it has been read."""
        return self._digest.hexdigest()

    def read(self) -> Iterator[tuple[int, FrameBlock | RecordBlock | None]]:
        """Yield (bytes read, their messages), None where they complete none, to the end."""
        with self._file.open("rb") as file:
            for size, block in self._reader.read():
                self._digest.update(file.read(size))
                yield size, block


InMemory: TypeAlias = TlogReader


def in_memory(pieces: Iterable[bytes], wanted: Iterable[str]) -> InMemory:
    """Return the reader of a telemetry log in memory, in pieces that may be cut anywhere."""
    return TlogReader(pieces, Decoder(wanted))
