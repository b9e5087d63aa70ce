"""The MCAP file: every sample, estimate and mode as protobuf, in chunks of at most a second."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from yawid import __version__
from yawid.blocks import EstimateBlock, ModesBlock, SampleBlock
from yawid.errors import SinkError
from yawid.sinks.base import LogLevel, Pace, open_part, os_errors_as_sink_error, sync
from yawid.sinks.mcap_chunks import ChunkWriter, Topic
from yawid.sinks.messages import (
    Written,
    estimate_rows,
    joined,
    log_message,
    modes_rows,
    sample_rows,
    verdict_message,
)
from yawid.sinks.schemas import TOPICS, schema_data, units

LIBRARY: Final = f"yawid {__version__}"
CHUNK_NS: Final = 1_000_000_000
FLUSH_S: Final = (
    0.5  # of wall time: with a caller that comes every half second no more than 1 s is lost
)
_MOST_WAITING: Final = 64
_MEDIA_TYPES: Final = {
    ".json": "application/json",
    ".toml": "application/toml",
    ".txt": "text/plain",
}


def _as_record(value: str | Mapping[str, object]) -> dict[str, str]:
    """Return a metadata record, string to string; nested mappings become dotted names."""
    if isinstance(value, str):
        return {"text": value}
    record: dict[str, str] = {}
    for name, entry in value.items():
        if isinstance(entry, Mapping):
            record |= {f"{name}.{inner}": text for inner, text in _as_record(entry).items()}
        else:
            # A file's name may hold bytes that are no UTF-8.
            text = entry if isinstance(entry, str) else json.dumps(entry)
            record[name] = text.encode("utf-8", "backslashreplace").decode()
    return record


class McapSink:
    """Writes ``<path>.part`` at once and gives it the name ``path`` when finished.

    ``path`` may be changed before the end. ``metadata`` becomes one record per name; a text is held
    under the key ``text``. ``log_time`` is the vehicle's time mapped to Unix, never decreasing on a
    topic; ``publish_time`` is the receive stamp. For each sample the order in the file is sample,
    estimates, modes.

    Raises:
        SinkError: the file exists and ``force`` is not set, or it cannot be written.
    """

    def __init__(
        self,
        path: Path,
        metadata: Mapping[str, str | Mapping[str, object]],
        *,
        force: bool = False,
    ) -> None:
        self.path = path
        self._part, self._stream = open_part(path, force=force)
        self._pace = Pace(FLUSH_S)
        self._schemas: dict[str, int] = {}
        self._records: set[str] = set()
        self._inputs: tuple[str, ...] = ()
        self._estimate_channels: dict[str, int] = {}
        self._sample_ns = self._log_ns = self._rows = 0
        self._waiting: list[Written] = []
        self._writer = ChunkWriter(self._stream, path.parent, CHUNK_NS)
        try:
            self._open(metadata)
        except SinkError:
            self.discard()  # nothing in it, and it would stand in the way
            raise

    def start(
        self,
        parameter_names: tuple[str, ...],
        inputs: tuple[str, ...],
        methods: tuple[str, ...],
        sample_time_s: float,
    ) -> None:
        """See :meth:`yawid.sinks.base.Sink.start`; the names also stand with each channel."""
        self._inputs = inputs
        names = {"inputs": " ".join(inputs), "sample_time_s": repr(sample_time_s)}
        parameters = {"parameters": " ".join(parameter_names)}
        with os_errors_as_sink_error(self._part):
            self._add_record("grid", names | parameters | {"methods": " ".join(methods)})
            self._sample_channel = self._channel("/yawid/sample", names)
            for method in methods:
                topic = "/yawid/estimate" + ("" if method == methods[0] else f"/{method}")
                self._estimate_channels[method] = self._channel(
                    topic, {"method": method} | parameters
                )
            self._modes_channel = self._channel("/yawid/modes", {"method": methods[0]})
            self._stream.flush()

    def write(
        self, samples: SampleBlock, estimates: Mapping[str, EstimateBlock], modes: ModesBlock
    ) -> None:
        """See :meth:`yawid.sinks.base.Sink.write`; rows wait until they fill a chunk."""
        self._waiting.append(Written(samples, estimates, modes))
        span_ns = self._waiting[0].samples.unix_ns[0], samples.unix_ns[-1]
        if self._writer.would_end(*span_ns) or len(self._waiting) == _MOST_WAITING:
            self._write_waiting()

    def _write_waiting(self) -> None:
        """Write the rows that wait: to lay out one costs as much as to lay out a hundred."""
        if not self._waiting:
            return
        samples, estimates, modes = joined(self._waiting)
        self._waiting = []
        topics = [
            Topic(self._sample_channel, sample_rows(samples, self._inputs)),
            *(
                Topic(self._estimate_channels[method], estimate_rows(samples, estimate))
                for method, estimate in estimates.items()
            ),
            Topic(self._modes_channel, modes_rows(samples, modes)),
        ]
        log_ns = np.maximum.accumulate(np.maximum(samples.unix_ns, self._sample_ns))
        publish_ns = np.maximum(samples.received_us, 0) * 1000
        with os_errors_as_sink_error(self._part):
            self._writer.add_rows(topics, log_ns, publish_ns, self._rows)
        self._rows += len(samples)
        self._sample_ns = int(log_ns[-1])

    def log(self, unix_ns: int, level: LogLevel, text: str) -> None:
        """See :meth:`yawid.sinks.base.Sink.log`."""
        self._log_ns = max(unix_ns, self._log_ns)
        self._write_waiting()
        with os_errors_as_sink_error(self._part):
            message = log_message(unix_ns, level, text)
            self._writer.add_message(self._log_channel, self._log_ns, message)

    def flush(self) -> None:
        """See :meth:`yawid.sinks.base.Sink.flush`."""
        if self._pace.due():
            self._write_waiting()
            with os_errors_as_sink_error(self._part):
                self._writer.end_chunk()
                sync(self._stream)

    def finish(self, summary: Mapping[str, Any], attachments: Mapping[str, bytes]) -> None:
        """Write verdict, provenance and attachments, then rename; see the protocol."""
        self._write_waiting()
        last_ns = max(self._sample_ns, self._log_ns)
        with os_errors_as_sink_error(self._part):
            verdict = verdict_message(summary["verdict"])
            self._writer.add_message(self._verdict_channel, last_ns, verdict)
            names = ("log", "sha256", "bytes_read")
            source = {name: summary[name] for name in names if name in summary}
            self._add_record("source", source)
            for name in ("vehicle", "channels", "link"):
                self._add_record(name, summary.get(name, {}))
            for name, data in attachments.items():
                media_type = _MEDIA_TYPES.get(Path(name).suffix, "application/octet-stream")
                self._writer.add_attachment(last_ns, name, media_type, data)
            self._writer.finish()
            self._writer.close()
            sync(self._stream)
            self._stream.close()
            self._part.replace(self.path)

    def abort(self) -> None:
        """See :meth:`yawid.sinks.base.Sink.abort`."""
        # The error that led here has been told already.
        with contextlib.suppress(OSError, SinkError):
            if not self._stream.closed:
                self._write_waiting()
        with contextlib.suppress(OSError):
            if not self._stream.closed:
                self._writer.finish()
        for closed in (self._writer, self._stream):
            with contextlib.suppress(OSError):
                closed.close()

    def discard(self) -> None:
        """Abort and remove what was written; it is this sink's own, nobody else may."""
        self.abort()
        with contextlib.suppress(OSError):
            self._part.unlink(missing_ok=True)

    def _open(self, metadata: Mapping[str, str | Mapping[str, object]]) -> None:
        with os_errors_as_sink_error(self._part):
            self._writer.start(LIBRARY)
            for name, value in metadata.items():
                self._add_record(name, value)
            self._add_record("units", units())
            self._log_channel = self._channel("/yawid/log")
            self._verdict_channel = self._channel("/yawid/verdict")
            self._stream.flush()

    def _channel(self, topic: str, metadata: Mapping[str, str] | None = None) -> int:
        schema = TOPICS[topic]
        if schema not in self._schemas:
            self._schemas[schema] = self._writer.register_schema(
                schema, "protobuf", schema_data(schema)
            )
        return self._writer.register_channel(
            topic, "protobuf", self._schemas[schema], metadata or {}
        )

    def _add_record(self, name: str, value: str | Mapping[str, object]) -> None:
        """Write a metadata record, unless it is empty or one of this name is there already."""
        if value and name not in self._records:
            self._records.add(name)
            self._writer.add_metadata(name, _as_record(value))
