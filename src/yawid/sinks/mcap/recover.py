"""How a whole MCAP file is made from one that a crash, a power cut or a bad disk has damaged.

Messages are in chunks with a checksum, but the records with the meaning of their numbers are
between the chunks without one: a single wrong byte there could give a whole run another topic.
Therefore :class:`_Known` holds the channels and schemas that can be trusted, and only their
messages are copied.
"""

import os
import struct
import zlib
from collections import Counter, defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO, Final

from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, McapRecord, Message, Metadata, Schema
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import CompressionType, Writer
from yawid.errors import SinkError
from yawid.sinks.mcap.chunks import MAGIC
from yawid.sinks.mcap.reader import DAMAGE, is_bomb
from yawid.sinks.mcap.remains import NAMES, SUMMARY, Remains
from yawid.sinks.mcap.schemas import LOG, TOPICS, is_ours
from yawid.system.part_file import written_whole
from yawid.version import __version__

LIBRARY: Final = f"yawid {__version__} (recovered)"
CHUNK: Final = "damaged chunk"
SCHEMA: Final = "schema that is damaged or of another version of yawid, which alone can recover it"
CHANNEL: Final = "unknown or damaged channel record"
MESSAGE: Final = "message of no known channel"
ATTACHMENT: Final = "damaged attachment"
_FOOTER: Final = struct.Struct("<BQQQI8s")  # opcode, length, summary, its offsets, crc, magic
_READ: Final = 1 << 20


@dataclass(frozen=True, slots=True)
class Recovered:
    """The number of messages copied by topic, and of records left out as not trusted by kind."""

    counts: Counter[str] = field(default_factory=Counter)
    missing: Counter[str] = field(default_factory=Counter)

    @property
    def left_out(self) -> str:
        """The records that were left out, in words; "" where there are none."""
        kinds = (CHUNK, SCHEMA, CHANNEL, MESSAGE, ATTACHMENT)
        return ", ".join(f"{self.missing[kind]} x {kind}" for kind in kinds if self.missing[kind])


def recover(path_in: Path, path_out: Path, *, force: bool = False) -> Recovered:
    """Copy every complete chunk of ``path_in`` to ``path_out`` and return what was copied.

    Only what can be trusted is copied: chunks and attachments with a correct checksum, and from the
    chunks the messages of channels that yawid writes (:meth:`_Known.read`). Records after a damaged
    record length cannot be found. Metadata have no checksum and are copied as found. A file without
    a summary, or whose messages are not all copied, gets a summary that reports that
    (:mod:`yawid.sinks.mcap.remains`).

    Raises:
        SinkError: ``path_in`` has nothing that can be trusted, or a file cannot be read or written.
    """
    try:
        stream = path_in.open("rb")
    except OSError as error:
        raise SinkError(f"cannot read {path_in}: {error.strerror}") from error
    with stream:
        if not stream.seekable():
            raise SinkError(f"cannot read {path_in}: it must be a file, as it is read twice")
        # The suffix is not ".part": the file to be recovered may have that name.
        with written_whole(path_out, force=force, suffix=".recovered.part") as out:
            recovered = _Copy(out, stream, path_in).run()
            # The schema of log lines is Foxglove's, so that log lines alone prove nothing.
            only_log = recovered.missing[SCHEMA] > 0 and recovered.counts.keys() <= {LOG}
            if only_log or not recovered.counts:
                why = f" ({recovered.left_out})" if recovered.left_out else ""
                raise SinkError(
                    f"{path_in} holds no intact message of a run{why}: nothing was recovered"
                )
    return recovered


def _chunk_records(chunk: Chunk) -> list[McapRecord] | None:
    """Return the records in a chunk, None where it is damaged or unpacks to too much."""
    try:
        return None if is_bomb(chunk) else breakup_chunk(chunk, validate_crc=True)
    except DAMAGE:
        return None


class _Copy:
    """The copying of a run to a new file, in which schemas and channels get new numbers."""

    def __init__(self, out: BinaryIO, stream: BinaryIO, path_in: Path) -> None:
        self._writer = Writer(out, compression=CompressionType.ZSTD)
        self._stream = stream
        self._result = Recovered()
        self._known = _Known(self._result.missing)
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}
        self._path_in = path_in
        self._newest_ns = 0
        self._remains = Remains()

    def run(self) -> Recovered:
        self._known.read(self._stream)
        self._writer.start(profile="", library=LIBRARY)
        for _, channel in sorted(self._known.channels.items()):
            self._channel(channel)
        self._stream.seek(0)
        for record in _records(self._stream):
            match record:
                case Chunk():
                    self._copy_chunk(record)
                case Metadata():
                    self._remains.metadata.setdefault(record.name, record.metadata)
                    self._writer.add_metadata(record.name, record.metadata)
                case Attachment():
                    self._copy_attachment(record)
                case _:  # schemas and channels are known; indexes and statistics are written again
                    pass
        self._write_attachments()
        self._writer.finish()
        return self._result

    def _write_attachments(self) -> None:
        lost = bool(self._result.missing[CHUNK] or self._result.missing[MESSAGE])
        found = self._remains.attached(self._path_in, self._result.left_out, lost=lost)
        for name, data in found.items():
            kind = "application/json" if name == SUMMARY else "application/toml"
            self._writer.add_attachment(self._newest_ns, self._newest_ns, name, kind, data)

    def _copy_chunk(self, chunk: Chunk) -> None:
        inside = _chunk_records(chunk)
        self._result.missing[CHUNK] += inside is None
        for record in inside or ():
            if isinstance(record, Schema | Channel):
                self._known.add(record)
            elif isinstance(record, Message):
                self._copy_message(record)
        self._writer.flush()  # each chunk is copied to a chunk of its own

    def _copy_message(self, message: Message) -> None:
        channel = self._known.channels.get(message.channel_id)
        if channel is None:
            self._result.missing[MESSAGE] += 1
            return
        self._writer.add_message(
            self._channel(channel),
            message.log_time,
            message.data,
            message.publish_time,
            message.sequence,
        )
        self._result.counts[channel.topic] += 1
        self._newest_ns = max(message.log_time, self._newest_ns)
        self._remains.add(channel.topic, message.log_time, message.data)

    def _copy_attachment(self, attachment: Attachment) -> None:
        builder = RecordBuilder()
        attachment.write(builder)
        self._stream.seek(-4, 1)  # to the checksum, which the library has skipped
        if self._stream.read(4) != bytes(builder.end())[-4:]:
            self._result.missing[ATTACHMENT] += 1
            return
        if attachment.name in NAMES:
            self._remains.attachments[attachment.name] = attachment.data
            return
        self._writer.add_attachment(
            attachment.create_time,
            attachment.log_time,
            attachment.name,
            attachment.media_type,
            attachment.data,
        )

    def _channel(self, channel: Channel) -> int:
        """Return the number of a channel in the new file."""
        if channel.topic not in self._channels:
            schema = self._known.schemas[channel.schema_id]
            if schema.name not in self._schemas:
                self._schemas[schema.name] = self._writer.register_schema(
                    schema.name, schema.encoding, schema.data
                )
            self._channels[channel.topic] = self._writer.register_channel(
                channel.topic,
                channel.message_encoding,
                self._schemas[schema.name],
                channel.metadata,
            )
        return self._channels[channel.topic]


class _Known:
    """The schemas and channels that can be trusted, by their numbers in the file.

    The others are counted in ``missing``: unknown or damaged channels, and schemas that this
    version does not write.
    """

    def __init__(self, missing: Counter[str]) -> None:
        self.schemas: dict[int, Schema] = {}
        self.channels: dict[int, Channel] = {}
        self._missing = missing

    def read(self, stream: BinaryIO) -> None:
        """Take the schemas and channels outside the chunks that can be trusted.

        Where the file ends with a summary whose checksum is correct, these are the summary's.
        Otherwise a schema must be equal, byte for byte, to one that this version writes, and a
        channel must have one of its topics with that topic's schema; where two different ones have
        the same number, neither is taken. The metadata of a channel are then taken as found.
        """
        if _seek_summary(stream):
            for record in _records(stream, within=True):
                if isinstance(record, Schema | Channel):
                    self.add(record)
            return
        claims: defaultdict[tuple[type, int], dict[str, Schema | Channel]] = defaultdict(dict)
        stream.seek(0)
        for record in _records(stream):
            if isinstance(record, Schema) and not is_ours(record.name, record.data):
                self._missing[SCHEMA] += 1
            elif isinstance(record, Channel) and record.topic not in TOPICS:
                self._missing[CHANNEL] += 1
            elif isinstance(record, Schema | Channel):
                name = record.name if isinstance(record, Schema) else record.topic
                claims[type(record), record.id].setdefault(name, record)
        for _, claimed in sorted(claims.items(), key=lambda each: each[0][0] is Channel):
            if len(claimed) == 1:  # schemas come first, since channels are checked against them
                self.add(*claimed.values())

    def add(self, record: Schema | Channel) -> None:
        """Take a schema, or a channel whose topic and schema fit; other channels are counted."""
        if isinstance(record, Schema):
            self.schemas[record.id] = record
            return
        schema = self.schemas.get(record.schema_id)
        if (
            schema is not None
            and schema.name == TOPICS.get(record.topic)
            and schema.encoding == record.message_encoding == "protobuf"
        ):
            self.channels[record.id] = record
        else:
            self._missing[CHANNEL] += 1


def _records(stream: BinaryIO, *, within: bool = False) -> Iterator[McapRecord]:
    """Yield the records outside chunks and the chunks themselves, up to the first damage.

    ``within``: the stream is at a place within the file, after its head.
    """
    try:
        yield from StreamReader(stream, skip_magic=within, emit_chunks=True).records
    except DAMAGE:
        return


def _seek_summary(stream: BinaryIO) -> bool:
    """Go to the start of the summary section; return whether its checksum is correct."""
    size = stream.seek(0, os.SEEK_END)
    if size < _FOOTER.size:
        return False
    stream.seek(size - _FOOTER.size)
    opcode, length, start, _, crc, magic = _FOOTER.unpack(stream.read(_FOOTER.size))
    if (opcode, length, magic) != (Opcode.FOOTER, 20, MAGIC) or not 0 < start < size:
        return False
    left, actual = size - start - 4 - len(MAGIC), 0  # all but the checksum and the magic
    stream.seek(start)
    while left > 0:
        part = stream.read(min(left, _READ))
        actual, left = zlib.crc32(part, actual), left - len(part)
    stream.seek(start)
    return bool(actual == crc)
