"""Forges a run's file: copies its records with changes that no run would write."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

from mcap.reader import make_reader
from mcap.writer import Writer


def _as_is(value: Any) -> Any:
    return value


def forge(
    source: Path,
    out: Path,
    *,
    summary: Callable[[Any], Any] = _as_is,
    toml: Callable[[str], str] = _as_is,
    metadata: Callable[[str, dict[str, str]], dict[str, str] | None] = lambda name, record: record,
    message: Callable[[str, int, bytes], bytes] = lambda topic, number, data: data,
    schema: Callable[[str, bytes], bytes] = lambda name, data: data,
    keeps: Callable[[str], bool] = lambda topic: True,
    log_time: Callable[[str, int], int] = lambda topic, time: time,
    attached: Callable[[str, bytes], bytes] = lambda name, data: data,
) -> Path:
    """Copy an MCAP, applying a function to each kind of part; ``keeps`` chooses topics.

    A record of metadata for which None is returned is left out.
    """
    with source.open("rb") as stream, out.open("wb") as target:
        reader, writer = make_reader(stream), Writer(target)
        writer.start(profile="", library="forged")
        channels: dict[str, int] = {}
        counts: Counter[str] = Counter()
        for found, channel, record in reader.iter_messages(log_time_order=False):
            topic, how = channel.topic, channel.message_encoding
            if not keeps(topic):
                continue
            if topic not in channels:
                data = schema(found.name, found.data)
                number = writer.register_schema(found.name, found.encoding, data)
                channels[topic] = writer.register_channel(topic, how, number, channel.metadata)
            data = message(topic, counts[topic], record.data)
            time = log_time(topic, record.log_time)
            writer.add_message(channels[topic], time, data, record.publish_time)
            counts[topic] += 1
        for each in reader.iter_metadata():
            if (changed := metadata(each.name, dict(each.metadata))) is not None:
                writer.add_metadata(each.name, changed)
        for attachment in reader.iter_attachments():
            data = attached(attachment.name, attachment.data)
            if attachment.name == "summary.json":
                made = summary(json.loads(data))
                data = made if isinstance(made, bytes) else json.dumps(made).encode()
            elif attachment.name == "configuration.toml":
                data = toml(data.decode()).encode()
            writer.add_attachment(0, 0, attachment.name, attachment.media_type, data)
        writer.finish()
    return out
