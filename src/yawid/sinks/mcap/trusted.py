"""Which channel and schema records of a damaged MCAP file can be vouched for.

Messages stand in chunks with a checksum, but the records that say what their numbers mean stand
between the chunks with none: one flipped byte there would make another topic of a whole run.
"""

from __future__ import annotations

import os
import struct
import zlib
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import BinaryIO, Final

from zstandard import ZstdError

from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, McapRecord, Schema
from mcap.stream_reader import StreamReader
from yawid.sinks.mcap.chunks import MAGIC
from yawid.sinks.mcap.schemas import TOPICS, schema_data

DAMAGE: Final = (McapError, struct.error, ValueError, ZstdError, MemoryError, OverflowError)
"""What mcap raises on damaged bytes: its own errors, short structs, bad text, absurd sizes."""
_FOOTER: Final = struct.Struct("<BQQQI8s")  # opcode, length, summary, its offsets, crc, magic
_READ: Final = 1 << 20


def records(stream: BinaryIO, *, within: bool = False) -> Iterator[McapRecord]:
    """Yield the records outside chunks and the chunks themselves, up to the first tear.

    ``within`` tells that the stream stands within the file, past its head.
    """
    try:
        yield from StreamReader(stream, skip_magic=within, emit_chunks=True).records
    except DAMAGE:
        return


@dataclass(slots=True)
class Known:
    """The schemas and channels that can be vouched for, by their numbers in the file.

    ``refused`` counts the channels that cannot, ``foreign`` the schemas that this version does not
    write.
    """

    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    refused: int = 0
    foreign: int = 0

    def add(self, record: Schema | Channel) -> None:
        """Take a record in whose bytes a checksum covers."""
        if isinstance(record, Schema):
            self.schemas[record.id] = record
        elif self._is_ours(record):
            self.channels[record.id] = record
        else:
            self.refused += 1

    def _is_ours(self, channel: Channel) -> bool:
        schema = self.schemas.get(channel.schema_id)
        return (
            schema is not None
            and schema.name == TOPICS.get(channel.topic)
            and schema.encoding == channel.message_encoding == "protobuf"
        )


def known(stream: BinaryIO) -> Known:
    """Return what the records outside chunks say of schemas and channels, where it can be trusted.

    A sound summary at the end of the file settles it. Without one a schema must be, byte for byte,
    one that this version writes, and a channel one of its topics with that topic's schema; where
    two such records claim one number, neither has it. The texts beside a channel (its metadata)
    are then as found.
    """
    found = Known()
    if _seek_summary(stream):
        for record in records(stream, within=True):
            if isinstance(record, Schema | Channel):
                found.add(record)
        return found
    claims: defaultdict[tuple[type, int], dict[str, Schema | Channel]] = defaultdict(dict)
    stream.seek(0)
    for record in records(stream):
        if isinstance(record, Schema) and record.data != _own_schema(record.name):
            found.foreign += 1
        elif isinstance(record, Channel) and record.topic not in TOPICS:
            found.refused += 1
        elif isinstance(record, Schema | Channel):
            name = record.name if isinstance(record, Schema) else record.topic
            claims[type(record), record.id].setdefault(name, record)
    for kind in (Schema, Channel):  # a channel is judged by its schema
        for (of, _), claimed in claims.items():
            if of is kind and len(claimed) == 1:
                found.add(*claimed.values())
    return found


def _own_schema(name: str) -> bytes | None:
    """Return the schema that this version writes under a name, None where it writes none."""
    return schema_data(name) if name in TOPICS.values() else None


def _seek_summary(stream: BinaryIO) -> bool:
    """Go to the start of the summary section; return whether its checksum holds."""
    size = stream.seek(0, os.SEEK_END)
    if size < _FOOTER.size:
        return False
    stream.seek(size - _FOOTER.size)
    opcode, length, start, _, crc, magic = _FOOTER.unpack(stream.read(_FOOTER.size))
    if (opcode, length, magic) != (Opcode.FOOTER, 20, MAGIC) or not 0 < start < size:
        return False
    left, actual = size - start - 4 - len(MAGIC), 0  # all but the checksum itself and the magic
    stream.seek(start)
    while left > 0:
        part = stream.read(min(left, _READ))
        actual, left = zlib.crc32(part, actual), left - len(part)
    stream.seek(start)
    return bool(actual == crc)
