"""A run's file that was cut off or damaged: the seconds before its first bad record.

Messages are in chunks with a checksum, but the records with the meaning of their numbers are
between the chunks without one: a single wrong byte there could give a whole run another topic.
Therefore such a record counts only if it is byte for byte one that this version writes, and the
first that does not, or that claims the number of another, ends the file.
"""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO, TypeAlias

from mcap.records import Channel, Chunk, Message, Metadata, Schema
from mcap.stream_reader import StreamReader, breakup_chunk
from yawid.answers.heard import LinkCounts
from yawid.answers.reasons import Reason, Verdict
from yawid.answers.run_summary import RunSummary
from yawid.config.run import RunConfig
from yawid.config.settings import check_settings
from yawid.errors import SourceError
from yawid.sinks.mcap.reader import DAMAGE, McapRun, is_bomb, opened, read_grid
from yawid.sinks.mcap.schemas import MOTION, SAMPLE, TOPICS, is_ours

Described: TypeAlias = tuple[Schema, Channel, Message]


def intact(stream: BinaryIO) -> Iterator[Metadata | Described]:
    """Yield the metadata, and each message with its schema and channel, up to the first bad record.

    Metadata have no checksum: they are taken as found.
    """
    schemas: dict[int, Schema] = {}
    channels: dict[int, Channel] = {}
    try:
        for outer in StreamReader(stream, emit_chunks=True).records:
            if isinstance(outer, Chunk) and is_bomb(outer):
                return
            inside = breakup_chunk(outer, validate_crc=True) if isinstance(outer, Chunk) else ()
            for record in inside or (outer,):
                match record:
                    case Metadata():
                        yield record
                    case Message():
                        channel = channels[record.channel_id]
                        yield schemas[channel.schema_id], channel, record
                    case Schema():
                        known = schemas.setdefault(record.id, record)
                        if known != record or not is_ours(record.name, record.data):
                            return
                    case Channel():
                        is_first = channels.setdefault(record.id, record) == record
                        name = schemas[record.schema_id].name
                        if not is_first or TOPICS.get(record.topic) != name:
                            return
    except (*DAMAGE, KeyError):
        return


class TornRun(McapRun):
    """A run of which the samples before the first bad record are read."""

    def _messages(self, stream: BinaryIO, topics: list[str]) -> Iterator[Described]:
        for found in intact(stream):
            if not isinstance(found, Metadata) and found[1].topic in topics:
                yield found


def open_torn(path: Path, why: SourceError) -> TornRun:
    """Return what a file that cannot be read as a whole has, without a judgement of its link.

    Raises:
        SourceError: ``why`` it cannot be read, where no sample comes before the first bad record.
    """
    metadata: dict[str, dict[str, str]] = {}
    topics, times_ns = set(), [0, 0]
    rows = 0
    with opened(path) as stream:
        for found in intact(stream):
            if isinstance(found, Metadata):
                metadata.setdefault(found.name, found.metadata)
                continue
            _, channel, message = found
            topics.add(channel.topic)
            if channel.topic == SAMPLE:
                times_ns = [times_ns[0] if rows else message.log_time, message.log_time]
                rows += 1
    try:
        texts = {name: _value(text) for name, text in metadata["configuration"].items()}
        given = {name: value for name, value in texts.items() if value is not None}
        config = RunConfig(**check_settings(given, "configuration"))
        grid = read_grid(metadata.get("grid"), config)
    except (ValueError, OverflowError, RecursionError, KeyError, TypeError):
        raise why from None
    if not rows:
        raise why
    seconds = (times_ns[1] - times_ns[0]) / 1e9
    said = (
        f"{path.name} was cut off or is damaged: it has {rows} samples, {seconds:.1f} s, and its "
        "link was not judged: replay the log itself for an answer"
    )
    summary = RunSummary(
        log=str(path.absolute()),
        duration_s=seconds,
        link=LinkCounts(),
        channels={},
        verdict=Verdict(usable=False, reasons=[Reason("interrupted", said, weight="fatal")]),
    )
    motion = {*MOTION[:2]} <= topics
    return TornRun(path, summary, metadata, {}, config, grid, rows=rows, has_motion=motion)


def _value(text: str) -> Any:
    """Return a setting from its text in the metadata, which is JSON or the setting itself."""
    try:
        return json.loads(text)
    except ValueError:
        return text
