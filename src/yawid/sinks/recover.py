"""A proper MCAP out of one that a crash, a power cut or a bad disk left torn."""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO, Final, get_args

from mcap.exceptions import McapError
from mcap.records import Attachment, Channel, Chunk, McapRecord, Message, Metadata, Schema
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import CompressionType, Writer
from zstandard import ZstdError, frame_content_size

from yawid import __version__
from yawid.config import Method
from yawid.errors import SinkError
from yawid.sinks.base import open_part, os_errors_as_sink_error, sync

LARGEST_CHUNK: Final = 64 << 20
"""Unpacked; yawid writes a chunk a second."""
LARGEST_RATIO: Final = 200
"""Of unpacked to packed, above a megabyte: Zstandard packs gigabytes of zeros into nothing, and
the library reads each nine of them as a record."""
TOPICS: Final = frozenset(
    [f"/yawid/{name}" for name in ("sample", "modes", "verdict", "log", "estimate")]
    + [f"/yawid/estimate/{method}" for method in get_args(Method)]
)
LIBRARY: Final = f"yawid {__version__} (recovered)"
# What mcap raises on damaged bytes: its own errors, short structs, bad text or CRC, absurd sizes.
_DAMAGE: Final = (McapError, struct.error, ValueError, ZstdError, MemoryError, OverflowError)


def recover(path_in: Path, path_out: Path, *, force: bool = False) -> dict[str, int]:
    """Copy every complete chunk of ``path_in`` to ``path_out`` and return the messages per topic.

    A chunk whose content is damaged is left out; what follows a damaged record length cannot be
    found again. Metadata and attachments that were written are kept.

    Raises:
        SinkError: nothing can be had from ``path_in``, or a file cannot be read or written.
    """
    try:
        stream = path_in.open("rb")
    except OSError as error:
        raise SinkError(f"cannot read {path_in}: {error.strerror}") from error
    with stream:
        # Not ".part": that may well be the name of the file to be recovered.
        part, out = open_part(path_out, force=force, suffix=".recovered.part")
        try:
            with out, os_errors_as_sink_error(part):
                counts = _Copy(out).run(stream)
                sync(out)
            if not counts:
                raise SinkError(f"{path_in} holds no complete chunk of messages: nothing recovered")
            with os_errors_as_sink_error(path_out):
                part.replace(path_out)
        finally:
            part.unlink(missing_ok=True)
    return counts


def _records(stream: BinaryIO) -> Iterator[McapRecord]:
    """Yield the records outside chunks and the chunks themselves, up to the first tear."""
    try:
        yield from StreamReader(stream, emit_chunks=True).records
    except _DAMAGE:
        return


def is_bomb(chunk: Chunk) -> bool:
    """Tell whether a chunk unpacks to so much that it is made to choke the reader.

    Raises:
        ZstdError: its content is no Zstandard frame.
    """
    unpacked = chunk.uncompressed_size
    if chunk.compression == "zstd":
        unpacked = max(unpacked, frame_content_size(chunk.data))
    return unpacked > min(LARGEST_CHUNK, max(1 << 20, LARGEST_RATIO * len(chunk.data)))


def _chunk_records(chunk: Chunk) -> list[McapRecord]:
    try:
        return [] if is_bomb(chunk) else breakup_chunk(chunk, validate_crc=True)
    except _DAMAGE:
        return []


class _Copy:
    """One run from a stream of records to a new file; schema and channel numbers are given anew."""

    def __init__(self, out: BinaryIO) -> None:
        self._writer = Writer(out, compression=CompressionType.ZSTD)
        self._schemas: dict[int, int] = {0: 0}  # 0 is the channel without a schema
        self._channels: dict[int, tuple[int, str]] = {}
        self._doubtful: set[int] = set()
        self._counts: Counter[str] = Counter()

    def run(self, stream: BinaryIO) -> dict[str, int]:
        self._writer.start(profile="", library=LIBRARY)
        for record in _records(stream):
            if isinstance(record, Chunk):
                for inner in _chunk_records(record):
                    self._copy(inner)
                self._writer.flush()  # chunks stay as long as they were
            else:
                self._copy(record)
        self._writer.finish()
        return dict(self._counts)

    def _copy(self, record: McapRecord) -> None:
        match record:
            case Schema() if record.id not in self._schemas:
                self._schemas[record.id] = self._writer.register_schema(
                    record.name, record.encoding, record.data
                )
            case Channel() if record.schema_id in self._schemas:
                self._add_channel(record)
            case Message() if record.channel_id in self._channels.keys() - self._doubtful:
                channel, topic = self._channels[record.channel_id]
                self._writer.add_message(
                    channel, record.log_time, record.data, record.publish_time, record.sequence
                )
                self._counts[topic] += 1
            case Metadata():
                self._writer.add_metadata(record.name, record.metadata)
            case Attachment():
                self._writer.add_attachment(
                    record.create_time,
                    record.log_time,
                    record.name,
                    record.media_type,
                    record.data,
                )
            case _:  # indexes and statistics are made anew
                pass

    def _add_channel(self, record: Channel) -> None:
        """Register a channel; where its record is damaged, which no CRC tells, its messages go."""
        if record.id in self._channels:
            if self._channels[record.id][1] != record.topic:
                self._doubtful.add(record.id)
        elif record.topic in TOPICS:
            channel = self._writer.register_channel(
                record.topic,
                record.message_encoding,
                self._schemas[record.schema_id],
                record.metadata,
            )
            self._channels[record.id] = channel, record.topic
