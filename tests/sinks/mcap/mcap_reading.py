"""A reader that knows of our MCAP files only what they themselves say."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from mcap.reader import make_reader
from sinks.sink_blocks import GRID, PARAMETERS, SUMMARY, Blocks, cut

from yawid.sinks.base import Done, RunRows
from yawid.sinks.mcap.sink import McapSink

INPUTS = ("rudder", "aileron")


def open_sink(path: Path, n_inputs: int = 1, parameters: tuple[str, ...] = PARAMETERS) -> McapSink:
    sink = McapSink(path, {"configuration": {"rate": 20.0, "method": "els"}, "note": "by hand"})
    sink.take(replace(GRID, parameters=parameters, inputs=INPUTS[:n_inputs]))
    return sink


def write_file(path: Path, blocks: Blocks, edges: list[int] | None = None) -> Path:
    sink = open_sink(path, blocks[0].u.shape[1])
    for block in cut(blocks, edges or []):
        sink.take(RunRows(*block))
    sink.take(Done(SUMMARY, {"summary.json": b"{}"}))
    return path


def column(messages: list[Any], field: str) -> Any:
    return np.array([getattr(payload, field) for _, payload in messages])


def foreign_class(schema: Any) -> Any:
    """The message class made of nothing but the schema in the file."""
    files = descriptor_pb2.FileDescriptorSet.FromString(schema.data)
    pool = descriptor_pool.DescriptorPool()
    for file in files.file:  # dependencies first, or Add refuses
        pool.AddSerializedFile(file.SerializeToString())
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(schema.name))


def decoded(path: Path) -> dict[str, list[Any]]:
    """Messages by topic in order of log time: the record and its decoded payload."""
    classes: dict[int, Any] = {}
    topics: dict[str, list[Any]] = {}
    with path.open("rb") as stream:
        for schema, channel, message in make_reader(stream, validate_crcs=True).iter_messages():
            if schema.id not in classes and schema.encoding == "protobuf":
                classes[schema.id] = foreign_class(schema)
            if channel.message_encoding == "json":
                assert schema.encoding == "jsonschema"
                payload: Any = SimpleNamespace(**json.loads(message.data))
                payload.SHAPE = json.loads(schema.data)
            else:
                payload = classes[schema.id].FromString(message.data)
            topics.setdefault(channel.topic, []).append((message, payload))
    return topics


def raw(path: Path) -> list[tuple[str, int, int, int, bytes]]:
    """Everything that was written, in the order of the file."""
    with path.open("rb") as stream:
        return [
            (channel.topic, message.log_time, message.publish_time, message.sequence, message.data)
            for _, channel, message in make_reader(stream).iter_messages(log_time_order=False)
        ]


def summary_of(path: Path) -> Any:
    """What stands at the end of the file: channels, statistics and the index of the chunks."""
    with path.open("rb") as stream:
        return make_reader(stream).get_summary()


def spans_ns(path: Path) -> list[int]:
    """How long each chunk of a file is, in ns."""
    return [c.message_end_time - c.message_start_time for c in summary_of(path).chunk_indexes]


def records_of(path: Path) -> tuple[list[tuple[str, dict[str, str]]], dict[str, tuple[str, bytes]]]:
    """The metadata by name in their order, and the media types and data of the attachments."""
    with path.open("rb") as stream:
        reader = make_reader(stream)
        metadata = [(each.name, dict(each.metadata)) for each in reader.iter_metadata()]
        return metadata, {a.name: (a.media_type, a.data) for a in reader.iter_attachments()}
