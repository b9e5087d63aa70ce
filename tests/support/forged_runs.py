"""Forges a run's file: copies its records with changes that no run would write."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer


def _as_is(value: Any) -> Any:
    return value


def forge(
    source: Path,
    out: Path,
    *,
    summary: Callable[[Any], Any] = _as_is,
    toml: Callable[[str], str] = _as_is,
    metadata: Callable[[str, dict[str, str]], dict[str, str]] = lambda name, record: record,
    message: Callable[[str, int, bytes], bytes] = lambda topic, number, data: data,
    keeps: Callable[[str], bool] = lambda topic: True,
    log_time: Callable[[str, int], int] = lambda topic, time: time,
) -> Path:
    """Copy an MCAP, applying a function to each kind of part; ``keeps`` chooses topics."""
    with source.open("rb") as stream, out.open("wb") as target:
        reader, writer = make_reader(stream), Writer(target, compression=CompressionType.ZSTD)
        writer.start(profile="", library="forged")
        channels: dict[str, int] = {}
        counts: dict[str, int] = {}
        for schema, channel, record in reader.iter_messages(log_time_order=False):
            assert schema is not None
            topic = channel.topic
            if not keeps(topic):
                continue
            if topic not in channels:
                number = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[topic] = writer.register_channel(
                    topic, channel.message_encoding, number, channel.metadata
                )
            counts[topic] = counts.get(topic, -1) + 1
            writer.add_message(
                channels[topic],
                log_time(topic, record.log_time),
                message(topic, counts[topic], record.data),
                record.publish_time,
            )
        for found in reader.iter_metadata():
            writer.add_metadata(found.name, metadata(found.name, dict(found.metadata)))
        for attachment in reader.iter_attachments():
            data = attachment.data
            if attachment.name == "summary.json":
                made = summary(json.loads(data))
                data = made if isinstance(made, bytes) else json.dumps(made).encode()
            elif attachment.name == "configuration.toml":
                data = toml(data.decode()).encode()
            writer.add_attachment(0, 0, attachment.name, attachment.media_type, data)
        writer.finish()
    return out
