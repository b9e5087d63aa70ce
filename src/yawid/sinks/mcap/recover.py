"""A proper MCAP out of one that a crash, a power cut or a bad disk left torn."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO, Final

from zstandard import frame_content_size

from mcap.data_stream import RecordBuilder
from mcap.records import Attachment, Channel, Chunk, McapRecord, Message, Metadata, Schema
from mcap.stream_reader import breakup_chunk
from mcap.writer import CompressionType, Writer
from yawid import __version__
from yawid.errors import SinkError
from yawid.sinks.mcap.remains import NAMES, SUMMARY, Remains
from yawid.sinks.mcap.schemas import LOG
from yawid.sinks.mcap.trusted import DAMAGE, Known, known, records
from yawid.sinks.part_file import open_part, os_errors_as_sink_error, sync

LARGEST_CHUNK: Final = 64 << 20
"""Unpacked; yawid writes a chunk a second."""
LARGEST_RATIO: Final = 200
"""Of unpacked to packed, above a megabyte: Zstandard packs gigabytes of zeros into nothing, and
the library reads each nine of them as a record."""
LIBRARY: Final = f"yawid {__version__} (recovered)"


@dataclass(slots=True)
class Recovered:
    """Messages copied per topic, and what could not be vouched for and was left out."""

    counts: Counter[str] = field(default_factory=Counter)
    channels: int = 0
    schemas: int = 0
    messages: int = 0
    chunks: int = 0
    attachments: int = 0

    @property
    def left_out(self) -> str:
        """What was left out, in words; "" where nothing was."""
        kinds = {
            "damaged chunk": self.chunks,
            "schema of another version of yawid, which alone can recover it, or damaged": (
                self.schemas
            ),
            "unknown or damaged channel record": self.channels,
            "message of no known channel": self.messages,
            "damaged attachment": self.attachments,
        }
        return ", ".join(f"{count} x {kind}" for kind, count in kinds.items() if count)


def recover(path_in: Path, path_out: Path, *, force: bool = False) -> Recovered:
    """Copy every complete chunk of ``path_in`` to ``path_out`` and return what was copied.

    Only what can be vouched for is copied: chunks and attachments whose checksum holds, and of
    them the messages of channels that yawid writes (:func:`yawid.sinks.mcap.trusted.known`). What
    follows a damaged record length cannot be found again. Metadata have no checksum and are copied
    as found. A file without a summary, or with one that tells of more than was copied, gets one
    that says so (:mod:`yawid.sinks.mcap.remains`).

    Raises:
        SinkError: nothing can be had from ``path_in``, or a file cannot be read or written.
    """
    try:
        stream = path_in.open("rb")
    except OSError as error:
        raise SinkError(f"cannot read {path_in}: {error.strerror}") from error
    with stream:
        if not stream.seekable():
            raise SinkError(f"cannot read {path_in}: it is read twice and must be a file")
        # Not ".part": that may well be the name of the file to be recovered.
        part, out = open_part(path_out, force=force, suffix=".recovered.part")
        try:
            with out, os_errors_as_sink_error(part):
                recovered = _Copy(out, known(stream), path_in).run(stream)
                sync(out)
            # The schema of log lines is Foxglove's: they alone are not worth a file.
            only_log = recovered.schemas > 0 and recovered.counts.keys() <= {LOG}
            if only_log or not recovered.counts:
                why = f" ({recovered.left_out})" if recovered.left_out else ""
                raise SinkError(
                    f"{path_in} holds no message of a run to be trusted{why}: nothing recovered"
                )
            with os_errors_as_sink_error(path_out):
                part.replace(path_out)
        finally:
            part.unlink(missing_ok=True)
    return recovered


def is_bomb(chunk: Chunk) -> bool:
    """Tell whether a chunk unpacks to so much that it is made to choke the reader.

    Raises:
        ZstdError: its content is no Zstandard frame.
    """
    unpacked = chunk.uncompressed_size
    if chunk.compression == "zstd":
        unpacked = max(unpacked, frame_content_size(chunk.data))
    return unpacked > min(LARGEST_CHUNK, max(1 << 20, LARGEST_RATIO * len(chunk.data)))


def _chunk_records(chunk: Chunk) -> list[McapRecord] | None:
    """Return what is in a chunk, None where it is damaged or a bomb."""
    try:
        return None if is_bomb(chunk) else breakup_chunk(chunk, validate_crc=True)
    except DAMAGE:
        return None


class _Copy:
    """One run from a stream of records to a new file, with new numbers of schemas and channels."""

    def __init__(self, out: BinaryIO, trusted: Known, path_in: Path) -> None:
        self._writer = Writer(out, compression=CompressionType.ZSTD)
        self._known = trusted
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}
        self._result = Recovered()
        self._path_in = path_in
        self._newest_ns = 0
        self._remains = Remains()

    def run(self, stream: BinaryIO) -> Recovered:
        self._writer.start(profile="", library=LIBRARY)
        for _, channel in sorted(self._known.channels.items()):
            self._channel(channel)
        stream.seek(0)
        for record in records(stream):
            match record:
                case Chunk():
                    self._copy_chunk(record)
                case Metadata():
                    self._remains.metadata.setdefault(record.name, record.metadata)
                    self._writer.add_metadata(record.name, record.metadata)
                case Attachment():
                    self._copy_attachment(record, stream)
                case _:  # schemas and channels are known; indexes and statistics are made again
                    pass
        self._result.channels, self._result.schemas = self._known.refused, self._known.foreign
        self._write_attachments()
        self._writer.finish()
        return self._result

    def _write_attachments(self) -> None:
        """Write what the file says of itself."""
        lost = bool(self._result.chunks or self._result.messages)
        found = self._remains.attached(self._path_in, self._result.left_out, lost=lost)
        for name, data in found.items():
            kind = "application/json" if name == SUMMARY else "application/toml"
            self._writer.add_attachment(self._newest_ns, self._newest_ns, name, kind, data)

    def _copy_chunk(self, chunk: Chunk) -> None:
        inside = _chunk_records(chunk)
        self._result.chunks += inside is None
        for record in inside or ():
            if isinstance(record, Schema | Channel):
                self._known.add(record)
            elif isinstance(record, Message):
                self._copy_message(record)
        self._writer.flush()  # chunks stay as long as they were

    def _copy_message(self, message: Message) -> None:
        channel = self._known.channels.get(message.channel_id)
        if channel is None:
            self._result.messages += 1
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

    def _copy_attachment(self, attachment: Attachment, stream: BinaryIO) -> None:
        builder = RecordBuilder()
        attachment.write(builder)
        stream.seek(-4, 1)  # its checksum, which the library skips
        if stream.read(4) != bytes(builder.end())[-4:]:
            self._result.attachments += 1
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
