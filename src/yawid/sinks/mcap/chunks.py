"""An MCAP file whose chunks are made from whole arrays of messages.

Most records are written by the mcap library. Only those whose number grows with the samples are
made here: messages and their indexes by NumPy, chunks and their indexes by struct. The format is
that of https://mcap.dev/spec. In a chunk the messages of each channel are together.
"""

import struct
import zlib
from collections import defaultdict
from collections.abc import Mapping, Sequence
from typing import Any, BinaryIO, Final, NamedTuple

import numpy as np
from zstandard import ZstdCompressor

from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
)
from yawid.blocks import Array, Ints

MAGIC: Final = b"\x89MCAP0\r\n"
_HEAD: Final = [("opcode", "u1"), ("length", "<u8"), ("channel", "<u2"), ("sequence", "<u4"),
                ("log", "<u8"), ("publish", "<u8")]  # fmt: skip
_RECORD: Final = 9  # bytes of a record before its content: opcode and length
_FIELDS: Final = 22  # bytes of a message's content before its data
_INDEX: Final = struct.Struct("<BQHI")
_COMPRESSION: Final = b"\x04\0\0\0zstd"
_LEVEL: Final = -1  # level of zstd: it takes a quarter less time than 1, and 3 % more bytes
_CHUNK: Final = struct.Struct("<BQQQQI8sQ")
_CHUNK_INDEX: Final = struct.Struct("<BQQQQQI")
_PLACE: Final = struct.Struct("<HQ")
_CHUNK_SIZES: Final = struct.Struct("<Q8sQQ")
_FOOTER: Final = struct.Struct("<BQQQ")
_MOST_ROWS: Final = 4096  # in a chunk of each topic: a clock that stands still would end none
_SUMMARY: Final = (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.STATISTICS, Opcode.CHUNK_INDEX,
                   Opcode.ATTACHMENT_INDEX, Opcode.METADATA_INDEX)  # fmt: skip


class Topic(NamedTuple):
    """Messages of one channel, all of the same size: structured rows (n,) with their times (n,).

    ``log_ns`` must not decrease.
    """

    channel: int
    log_ns: Ints
    publish_ns: Ints
    rows: Array

    def part(self, rows: slice) -> "Topic":
        """Return some of its messages."""
        return Topic(self.channel, self.log_ns[rows], self.publish_ns[rows], self.rows[rows])


class ChunkWriter:
    """The writer of one file: ``start``, then records in any order, at the end ``finish``.

    ``end_chunk`` may be called at any time. The index of the chunks, which comes at the end of the
    file, waits in memory: 20 MB for a day.
    """

    def __init__(self, stream: BinaryIO, chunk_ns: int) -> None:
        self._stream = stream
        self._chunk_ns = chunk_ns
        self._offset = 0
        self._compressor = ZstdCompressor(_LEVEL)
        self._summary: dict[Opcode, list[bytes]] = defaultdict(list)
        self._counts: dict[int, int] = defaultdict(int)
        self._first_ns: int | None = None
        self._last_ns = 0
        self._start_ns: int | None = None
        self._open: dict[int, list[Topic]] = {}

    def start(self, library: str) -> None:
        """Write the head of the file; ``library`` names the program that writes it."""
        self._write(MAGIC + _bytes_of(Header(profile="", library=library)))

    def register_schema(self, name: str, encoding: str, data: bytes) -> int:
        """Write a schema; return its number."""
        number = len(self._summary[Opcode.SCHEMA]) + 1
        schema = Schema(id=number, name=name, encoding=encoding, data=data)
        self._keep(Opcode.SCHEMA, schema)
        return number

    def register_channel(
        self, topic: str, encoding: str, schema: int, metadata: Mapping[str, str]
    ) -> int:
        """Write a channel; return its number."""
        number = len(self._summary[Opcode.CHANNEL]) + 1
        channel = Channel(number, topic, encoding, dict(metadata), schema_id=schema)
        self._keep(Opcode.CHANNEL, channel)
        return number

    def add_message(self, channel: int, log_ns: int, data: bytes) -> None:
        """Add one message."""
        time = np.array([log_ns])
        self.add_rows([Topic(channel, time, time, np.frombuffer(data, f"V{len(data)}"))])

    def add_rows(self, topics: Sequence[Topic]) -> None:
        """Add the messages of several topics; a chunk ends before it is ``chunk_ns`` long."""
        rest = [self._recorded(topic) for topic in topics if len(topic.rows)]
        while rest:
            if self._start_ns is None:
                self._start_ns = min(int(topic.log_ns[0]) for topic in rest)
            end_ns = self._start_ns + self._chunk_ns
            stops = [min(int(each.log_ns.searchsorted(end_ns)), _MOST_ROWS) for each in rest]
            for topic, stop in zip(rest, stops, strict=True):
                if stop:
                    self._open.setdefault(topic.channel, []).append(topic.part(slice(stop)))
            pairs = zip(rest, stops, strict=True)
            rest = [topic.part(slice(n, None)) for topic, n in pairs if n < len(topic.rows)]
            counts = [sum(len(part.rows) for part in parts) for parts in self._open.values()]
            if rest or max(counts) >= _MOST_ROWS:
                self.end_chunk()

    def _recorded(self, topic: Topic) -> Topic:
        """Return a topic whose rows are whole message records, numbered on from those before."""
        first = self._counts[topic.channel]
        self._counts[topic.channel] += len(topic.rows)
        return topic._replace(rows=_records(topic, first))

    def end_chunk(self) -> None:
        """Write the chunk and its indexes, if there is anything in it."""
        parts: list[bytes] = []
        indexes: dict[int, bytes] = {}
        times: list[int] = []
        size = 0
        for channel, topics in sorted(self._open.items()):
            pairs = []
            for topic in topics:
                records = topic.rows
                pair = np.empty((len(records), 2), "<u8")
                pair[:, 0], pair[:, 1] = topic.log_ns, records.itemsize * np.arange(len(records))
                pair[:, 1] += size
                pairs.append(pair.tobytes())
                parts.append(records.tobytes())
                size += records.nbytes
                times += [int(topic.log_ns[0]), int(topic.log_ns[-1])]
            indexes[channel] = b"".join(pairs)
        self._open, self._start_ns = {}, None
        if parts:
            self._write_chunk(b"".join(parts), indexes, min(times), max(times))

    def add_metadata(self, name: str, record: Mapping[str, str]) -> None:
        """Write a metadata record."""
        place = self._placed(_bytes_of(Metadata(name=name, metadata=dict(record))))
        index = MetadataIndex(*place, name)
        self._summary[Opcode.METADATA_INDEX].append(_bytes_of(index))

    def add_attachment(self, log_ns: int, name: str, media_type: str, content: bytes) -> None:
        """Write an attachment."""
        place = self._placed(_bytes_of(Attachment(log_ns, log_ns, name, media_type, content)))
        index = AttachmentIndex(*place, log_ns, log_ns, len(content), name, media_type)
        self._summary[Opcode.ATTACHMENT_INDEX].append(_bytes_of(index))

    def finish(self) -> None:
        """Write the last chunk, the summary and the end."""
        self.end_chunk()
        statistics = Statistics(
            message_count=sum(self._counts.values()),
            schema_count=len(self._summary[Opcode.SCHEMA]),
            channel_count=len(self._summary[Opcode.CHANNEL]),
            attachment_count=len(self._summary[Opcode.ATTACHMENT_INDEX]),
            metadata_count=len(self._summary[Opcode.METADATA_INDEX]),
            chunk_count=len(self._summary[Opcode.CHUNK_INDEX]),
            message_start_time=self._first_ns or 0,
            message_end_time=self._last_ns,
            channel_message_counts=dict(self._counts),
        )
        self._summary[Opcode.STATISTICS] = [_bytes_of(statistics)]
        self._write(_bytes_of(DataEnd(data_section_crc=0)))
        summary = b"".join(part for opcode in _SUMMARY for part in self._summary[opcode])
        # The checksum covers the footer up to itself.
        crc = zlib.crc32(summary + _FOOTER.pack(Opcode.FOOTER, 20, self._offset, 0))
        footer = Footer(summary_start=self._offset, summary_offset_start=0, summary_crc=crc)
        self._write(summary + _bytes_of(footer) + MAGIC)

    def _keep(self, opcode: Opcode, record: McapRecord) -> None:
        data = _bytes_of(record)
        self._placed(data)
        self._summary[opcode].append(data)

    def _placed(self, data: bytes) -> tuple[int, int]:
        """Write a record after the open chunk; return its place, as offset and length."""
        self.end_chunk()
        self._write(data)
        return self._offset - len(data), len(data)

    def _write(self, data: bytes) -> None:
        self._stream.write(data)
        self._offset += len(data)

    def _write_chunk(self, data: bytes, messages: dict[int, bytes], low: int, high: int) -> None:
        self._first_ns = low if self._first_ns is None else min(low, self._first_ns)
        self._last_ns = max(high, self._last_ns)
        packed = self._compressor.compress(data)
        content = _CHUNK.size - _RECORD + len(packed)
        sizes = len(data), zlib.crc32(data), _COMPRESSION, len(packed)
        start, length = self._offset, _RECORD + content
        chunk = _CHUNK.pack(Opcode.CHUNK, content, low, high, *sizes)
        indexes, places = bytearray(), bytearray()
        for channel, pairs in messages.items():
            places += _PLACE.pack(channel, start + length + len(indexes))
            indexes += _INDEX.pack(Opcode.MESSAGE_INDEX, 6 + len(pairs), channel, len(pairs))
            indexes += pairs
        self._write(b"".join((chunk, packed, indexes)))  # one system call instead of two
        content = _CHUNK_INDEX.size - _RECORD + len(places) + _CHUNK_SIZES.size
        head = _CHUNK_INDEX.pack(Opcode.CHUNK_INDEX, content, low, high, start, length, len(places))
        tail = _CHUNK_SIZES.pack(len(indexes), _COMPRESSION, len(packed), len(data))
        self._summary[Opcode.CHUNK_INDEX].append(bytes(head + places + tail))


def _records(topic: Topic, first: int) -> Array:
    """Return whole message records (n,); their sequence numbers begin with ``first``."""
    n, size = len(topic.rows), topic.rows.dtype.itemsize
    records = np.empty(n, np.dtype([*_HEAD, ("data", f"V{size}")]))
    records["opcode"], records["length"], records["channel"] = (
        Opcode.MESSAGE,
        _FIELDS + size,
        topic.channel,
    )
    records["sequence"] = (first + np.arange(n)) & 0xFFFFFFFF
    records["log"], records["publish"] = topic.log_ns, topic.publish_ns
    records["data"] = topic.rows.view(f"V{size}")  # as plain bytes: by field takes longer
    return records


def _bytes_of(record: Any) -> bytes:  # Any: every record has a method write, their base has none
    builder = RecordBuilder()
    record.write(builder)
    return bytes(builder.end())
