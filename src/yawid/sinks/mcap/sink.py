"""The MCAP sink: samples and estimates as protobuf, answers as JSON, in chunks of a second."""

import contextlib
import json
import math
from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

import numpy as np

from yawid.answers.run_summary import FORM, RunSummary
from yawid.blocks import Array, Ints, MotionBlock, SampleBlock
from yawid.errors import SinkError
from yawid.sinks.base import (
    Abort,
    Done,
    Event,
    Flush,
    Found,
    FoundBare,
    Grid,
    LogLine,
    Pace,
    RunRows,
    Sink,
)
from yawid.sinks.mcap.answers import (
    FLIGHT,
    LATERAL,
    MANOEUVRE,
    NAMES,
    ORDINARY,
    row_of,
    schema_of,
)
from yawid.sinks.mcap.chunks import ChunkWriter, Topic
from yawid.sinks.mcap.messages import (
    estimate_rows,
    joined,
    log_message,
    mode_message,
    modes_rows,
    motion_rows,
    sample_rows,
    verdict_message,
)
from yawid.sinks.mcap.schemas import (
    LOG,
    MODE,
    MODES,
    SAMPLE,
    TOPICS,
    VERDICT,
    estimate_topics,
    schema_data,
    units,
)
from yawid.system.part_file import Disk, Part, os_errors_as_sink_error
from yawid.version import __version__

CHUNK_NS: Final = 1_000_000_000
FLUSH_S: Final = 0.5
"""The least time between two flushes, in wall time: with a call every half second, a crash loses
at most 1 s."""
_MOST_WAITING: Final = 64
_MOST_MOTION: Final = 100_000
"""The most rows of a kind of lateral motion that wait for samples."""
_END_NS: Final = 2**63 - 1
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
            # A file's name may hold bytes that are not UTF-8.
            text = entry if isinstance(entry, str) else json.dumps(entry)
            record[name] = text.encode("utf-8", "backslashreplace").decode()
    return record


class McapSink(Sink):
    """A sink that writes ``<path>.part``, which is renamed ``path`` when it is finished.

    ``path`` may be changed before the end. ``metadata`` becomes one record per name; a text gets
    the key ``text``. ``log_time`` is the vehicle's time mapped to Unix time and never decreases on
    a topic; ``publish_time`` is the receive stamp. Within a chunk the messages of a topic are
    together; lateral motion is not after the chunk of the samples of its time. An answer comes
    where it was reported, after samples that are newer. ``disk`` brings flushed data to the disk.

    Raises:
        SinkError: the file exists and ``force`` is not set, or it cannot be written.
    """

    def __init__(
        self,
        path: Path,
        metadata: Mapping[str, str | Mapping[str, object]],
        *,
        force: bool = False,
        disk: Disk | None = None,
    ) -> None:
        self.path: Path = path
        self._disk = disk or Disk()
        self._file = Part(path, force=force)
        self._part, self._stream = self._file.place, self._file.stream
        self._pace = Pace(FLUSH_S)
        self._schemas: dict[str, int] = {}
        self._records: set[str] = set()
        self._mode = math.nan
        self._parameters: tuple[str, ...] = ()
        self._channels: dict[str, int] = {}
        self._newest_ns: dict[str, int] = defaultdict(int)  # by topic
        self._waiting: list[RunRows] = []
        self._motion: dict[str, list[tuple[Ints, Array]]] = {}
        self._writer = ChunkWriter(self._stream, CHUNK_NS)
        try:
            self._open(metadata)
        except SinkError:
            self.take(Abort(discard=True))  # the file is empty and would block the next run
            raise

    def take(self, event: Event) -> None:
        """See :meth:`yawid.sinks.base.Sink.take`."""
        match event:
            case RunRows():
                self._write(event)
            case MotionBlock():
                self._move(event)
            case Flush():
                self._flush()
            case Grid():
                self._start(event)
            case LogLine():
                self._log(event)
            case Found():
                self._add_answer(MANOEUVRE, event.span_ns[1], row_of(event.manoeuvre))
            case FoundBare():
                self._add_answer(LATERAL, event.span_ns[1], event.bare.to_json())
            case Done():
                self._finish(event.summary, event.attachments)
            case Abort():
                self._write_last()
                (self._file.remove if event.discard else self._file.leave)()

    def _start(self, grid: Grid) -> None:
        """Add the channels, each with the grid's names."""
        self._grid, self._parameters = grid, grid.parameters
        record = {
            name: " ".join(value) if isinstance(value, tuple) else str(value)
            for name, value in asdict(grid).items()
        }
        names = {name: record[name] for name in ("inputs", "sample_time_s")}
        parameters = {"parameters": record["parameters"]}
        with os_errors_as_sink_error(self._part):
            self._add_record("units", units(grid.rudder_unit))
            self._add_record("grid", record)
            self._channel(SAMPLE, names)
            for method, topic in estimate_topics(grid.methods).items():
                self._channel(topic, {"method": method} | parameters)
            self._channel(MODES, {"method": grid.methods[0]})
            self._stream.flush()

    def _write(self, rows: RunRows) -> None:
        """Add rows, which wait for a second or for each other: many take the time of one."""
        self._waiting.append(rows)
        span_ns = rows.samples.unix_ns[-1] - self._waiting[0].samples.unix_ns[0]
        if span_ns >= CHUNK_NS or len(self._waiting) == _MOST_WAITING:
            self._write_waiting()

    def _move(self, block: MotionBlock) -> None:
        """Add motion, which waits for the samples of its time."""
        for topic, *new in motion_rows(block):
            self._motion.setdefault(topic, []).append((new[0], new[1]))
        if any(sum(len(n) for n, _ in parts) > _MOST_MOTION for parts in self._motion.values()):
            self._write_waiting(_END_NS)

    def _write_waiting(self, until_ns: int = 0) -> None:
        """Write the rows that wait, and the motion up to them or to ``until_ns``."""
        topics: list[Topic] = []
        with os_errors_as_sink_error(self._part):
            if self._waiting:
                samples, estimates, modes = joined(self._waiting)
                self._waiting = []
                log_ns = np.maximum.accumulate(np.maximum(samples.unix_ns, self._newest_ns[SAMPLE]))
                until_ns = max(until_ns, int(log_ns[-1]))
                self._newest_ns[SAMPLE] = int(log_ns[-1])
                rows = {SAMPLE: sample_rows(samples, self._grid.inputs)}
                for method, topic in estimate_topics(self._grid.methods).items():
                    rows[topic] = estimate_rows(samples, estimates[method], self._parameters)
                rows[MODES] = modes_rows(samples, modes)
                stamp_ns = np.maximum(samples.received_us, 0) * 1000
                for topic, found in rows.items():
                    topics.append(Topic(self._channel(topic), log_ns, stamp_ns, found))
                topics += self._mode_changes(samples, log_ns)
            motion, self._motion = self._motion, {}
            for topic, parts in motion.items():
                log_ns, rows_ = (np.concatenate(each) for each in zip(*parts, strict=True))
                count = int(log_ns.searchsorted(until_ns, "right"))
                topics.append(Topic(self._channel(topic), log_ns, log_ns, rows_).part(slice(count)))
                self._motion[topic] = [(log_ns[count:], rows_[count:])]
            self._writer.add_rows(topics)

    def _mode_changes(self, samples: SampleBlock, log_ns: Ints) -> Iterator[Topic]:
        """Yield a message for each change of flight mode."""
        known = np.nan_to_num(samples.mode, nan=-1.0)  # NaN would be a change at every row
        changed = known != np.concatenate([[self._mode], known[:-1]])
        self._mode = float(known[-1])
        for row in np.flatnonzero(changed).tolist():
            boot_s, mode = samples.boot_us[row] / 1e6, float(samples.mode[row])
            data = mode_message(boot_s, mode, self._grid.mode_name(mode))
            times = log_ns[row : row + 1]
            yield Topic(self._channel(MODE), times, times, np.frombuffer(data, f"V{len(data)}"))

    def _add_answer(self, topic: str, last_ns: int, answer: dict[str, Any]) -> None:
        """Add an answer; ``log_time`` is that of its last sample."""
        self._newest_ns[topic] = max(last_ns, self._newest_ns[topic])
        self._write_waiting()
        with os_errors_as_sink_error(self._part):
            # It has its own chunk: one shared with samples would reach back by seconds.
            self._writer.end_chunk()
            data = json.dumps(answer).encode()
            self._writer.add_message(self._channel(topic), self._newest_ns[topic], data)
            self._writer.end_chunk()

    def _log(self, line: LogLine) -> None:
        self._newest_ns[LOG] = max(line.unix_ns, self._newest_ns[LOG])
        self._write_waiting()
        with os_errors_as_sink_error(self._part):
            message = log_message(line.unix_ns, line.level, line.text)
            self._writer.add_message(self._channel(LOG), self._newest_ns[LOG], message)

    def _flush(self) -> None:
        if self._pace.due():
            self._write_waiting()
            with os_errors_as_sink_error(self._part):
                self._writer.end_chunk()
                self._disk.sync_soon(self._stream)

    def _finish(self, summary: RunSummary, attachments: Mapping[str, bytes]) -> None:
        """Write verdict, origin and attachments, then rename."""
        self._write_waiting(_END_NS)
        last_ns = max(self._newest_ns[SAMPLE], self._newest_ns[LOG])
        with os_errors_as_sink_error(self._part):
            if summary.verdict is not None:
                verdict = verdict_message(summary.verdict)
                self._writer.add_message(self._channel(VERDICT), last_ns, verdict)
            if summary.flight is not None:
                self._add_answer(FLIGHT, last_ns, row_of(summary.flight))
            if summary.ordinary is not None:
                self._add_answer(ORDINARY, last_ns, summary.ordinary.to_json())
            self._add_record("source", summary.own_source.to_json())
            objects = summary.to_json()
            for name in ("vehicle", "channels", "link"):
                self._add_record(name, objects.get(name, {}))
            for name, data in attachments.items():
                media_type = _MEDIA_TYPES.get(Path(name).suffix, "application/octet-stream")
                self._writer.add_attachment(last_ns, name, media_type, data)
            self._writer.finish()
            self._disk.sync_now(self._stream)
        self._file.take_name(self.path)

    def _write_last(self) -> None:
        # The error that led to this call has been reported already.
        if not self._stream.closed:
            with contextlib.suppress(OSError, SinkError):
                self._write_waiting(_END_NS)
            with contextlib.suppress(OSError):
                self._writer.finish()

    def _open(self, metadata: Mapping[str, str | Mapping[str, object]]) -> None:
        with os_errors_as_sink_error(self._part):
            self._writer.start(f"yawid {__version__}")
            self._add_record("answers", {"form": FORM})
            for name, value in metadata.items():
                self._add_record(name, value)
            for topic in (LOG, VERDICT):
                self._channel(topic)
            self._stream.flush()

    def _channel(self, topic: str, metadata: Mapping[str, str] | None = None) -> int:
        """Return the number of a topic's channel, which is written before its first message."""
        if topic not in self._channels:
            if topic in NAMES:
                name, kind = NAMES[topic], "json"
                schema = name, "jsonschema", schema_of(topic)
            else:
                name, kind = TOPICS[topic], "protobuf"
                schema = name, kind, schema_data(name, self._parameters)
            if name not in self._schemas:
                self._schemas[name] = self._writer.register_schema(*schema)
            number = self._schemas[name]
            self._channels[topic] = self._writer.register_channel(
                topic, kind, number, metadata or {}
            )
        return self._channels[topic]

    def _add_record(self, name: str, value: str | Mapping[str, object]) -> None:
        """Write a metadata record, unless it is empty or its name has been written already."""
        if value and name not in self._records:
            self._records.add(name)
            self._writer.add_metadata(name, _as_record(value))
