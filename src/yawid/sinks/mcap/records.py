"""The records of a run's file one after another, to its end or to its first bad record.

Anybody may have written the file: a chunk that unpacks to far more than its size is not read, and a
record that claims the number of another is an error.
"""

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO, Final, TypeAlias

from zstandard import ZstdError, frame_content_size

from mcap.exceptions import McapError
from mcap.records import Channel, Chunk, Message, Metadata, Schema
from mcap.stream_reader import StreamReader, breakup_chunk
from yawid.errors import SourceError
from yawid.sinks.mcap.answers import NAMES
from yawid.sinks.mcap.schemas import TOPICS

LARGEST_CHUNK: Final = 64 << 20
"""The largest unpacked chunk in bytes; yawid writes a chunk for each second."""
LARGEST_RATIO: Final = 200
"""The largest ratio of unpacked to packed bytes above a megabyte: Zstandard packs gigabytes of
zeros into almost nothing, and the library reads every nine of them as a record."""
DAMAGE: Final = (
    McapError, struct.error, ValueError, ZstdError, MemoryError, OverflowError, KeyError,
)  # fmt: skip
"""Errors on damaged bytes: of mcap, short structs, bad text, absurd sizes, unknown numbers."""
Described: TypeAlias = tuple[Schema, Channel, Message]


def opened(path: Path) -> BinaryIO:
    """Open a file for reading.

    Raises:
        SourceError: it cannot be read.
    """
    try:
        return path.open("rb")
    except OSError as error:
        raise SourceError(f"cannot read {path}: {error.strerror}") from error


def is_bomb(chunk: Chunk) -> bool:
    """Return whether a chunk unpacks to far more than its size, as one made to attack a reader.

    Raises:
        ZstdError: its content is not a Zstandard frame.
    """
    unpacked = chunk.uncompressed_size
    if chunk.compression == "zstd":
        unpacked = max(unpacked, frame_content_size(chunk.data))
    return unpacked > min(LARGEST_CHUNK, max(1 << 20, LARGEST_RATIO * len(chunk.data)))


def records(stream: BinaryIO) -> Iterator[Metadata | list[Described]]:
    """Yield the metadata, and of each chunk the messages, each with its schema and channel.

    Raises:
        Exception: one of ``DAMAGE``, at the first bad record.
    """
    schemas: dict[int, Schema] = {}
    channels: dict[int, Channel] = {}
    for outer in StreamReader(stream, emit_chunks=True).records:
        if isinstance(outer, Chunk) and is_bomb(outer):
            raise ValueError("one of its chunks unpacks to too much data")
        inside = breakup_chunk(outer, validate_crc=True) if isinstance(outer, Chunk) else [outer]
        found: list[Described] = []
        for record in inside:
            match record:
                case Metadata():
                    yield record
                case Message():
                    channel = channels[record.channel_id]
                    found.append((schemas[channel.schema_id], channel, record))
                case Schema():
                    is_first = schemas.setdefault(record.id, record) == record
                case Channel():
                    is_first = channels.setdefault(record.id, record) == record
            if isinstance(record, Schema | Channel) and not is_first:
                raise ValueError("a record has the number of another")
        if found:
            yield found


def intact(stream: BinaryIO) -> Iterator[Metadata | list[Described]]:
    """Yield the same up to the first bad record, without an error.

    Chunks have a checksum, but the records with the meaning of their numbers are between them
    without one: a single wrong byte there could give a whole run another topic. So a topic whose
    messages are of a type that this version does not write there ends the file, too. Metadata are
    taken as found.
    """
    try:
        for found in records(stream):
            of_topic = () if isinstance(found, Metadata) else found
            for schema, channel, _ in of_topic:
                if schema.name != {**NAMES, **TOPICS}.get(channel.topic):
                    return
            yield found
    except DAMAGE:
        return
