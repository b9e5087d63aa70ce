"""The MCAP sink: samples, estimates and modes as protobuf, in chunks of a second at most."""

import contextlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import asdict
from itertools import pairwise
from pathlib import Path
from typing import Final

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
from yawid.sinks.mcap.chunks import ChunkWriter, Topic
from yawid.sinks.mcap.messages import (
    estimate_rows,
    joined,
    lateral_message,
    log_message,
    manoeuvre_message,
    mode_message,
    modes_rows,
    sample_rows,
    verdict_message,
)
from yawid.sinks.mcap.motion_rows import motion_messages
from yawid.sinks.mcap.schemas import (
    FLIGHT,
    LATERAL,
    LOG,
    MANOEUVRE,
    MODES,
    MOTION_TABLE,
    ORDINARY_TOPIC,
    SAMPLE,
    TOPICS,
    VERDICT,
    estimate_topics,
    ordinary_schema,
    schema_data,
    units,
)
from yawid.system.part_file import Disk, Part, os_errors_as_sink_error
from yawid.version import __version__

LIBRARY: Final = f"yawid {__version__}"
CHUNK_NS: Final = 1_000_000_000
FLUSH_S: Final = 0.5
"""The least time between two flushes, in wall time: with a call every half second, a crash loses
at most 1 s."""
_MOST_WAITING: Final = 64
_MOST_MOTION: Final = 100_000
"""The most rows of lateral motion that wait for samples."""
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
    a topic; ``publish_time`` is the receive stamp. The order in the file is, for each sample:
    flight mode where it has changed, sample, estimates, modes; lateral motion comes before the
    samples of the same second. A manoeuvre comes where it was
    reported, after samples that are newer. ``disk`` brings flushed data to the disk.

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
        self._mode: float | None = None
        self._parameters: tuple[str, ...] = ()
        self._estimate_channels: dict[str, int] = {}
        self._answers: dict[str, tuple[int, int]] = {}  # by topic: its channel, its newest time
        self._sample_ns = self._log_ns = self._rows = 0
        self._waiting: list[RunRows] = []
        self._motion: dict[str, tuple[Ints, Array]] = {}
        self._motion_channels: dict[str, int] = {}
        self._motion_rows: dict[str, int] = {}
        self._writer = ChunkWriter(self._stream, path.parent, CHUNK_NS)
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
                message = manoeuvre_message(event.manoeuvre)
                self._add_answer(MANOEUVRE, event.span_ns[1], message)
            case FoundBare():
                message = lateral_message(event.n, event.bare)
                self._add_answer(LATERAL, event.span_ns[1], message)
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
            self._sample_channel = self._channel(SAMPLE, names)
            for method, topic in estimate_topics(grid.methods).items():
                self._estimate_channels[method] = self._channel(
                    topic, {"method": method} | parameters
                )
            self._modes_channel = self._channel(MODES, {"method": grid.methods[0]})
            self._mode_channel = self._channel("/yawid/mode")
            self._stream.flush()

    def _write(self, rows: RunRows) -> None:
        """Add rows, which wait until they fill a chunk."""
        self._waiting.append(rows)
        span_ns = self._waiting[0].samples.unix_ns[0], rows.samples.unix_ns[-1]
        if self._writer.would_end(*span_ns) or len(self._waiting) == _MOST_WAITING:
            self._write_waiting()

    def _write_waiting(self) -> None:
        """Write the rows that wait: a hundred rows take the same time as one."""
        if not self._waiting:
            return
        samples, estimates, modes = joined(self._waiting)
        self._waiting = []
        topics = [
            Topic(self._sample_channel, sample_rows(samples, self._grid.inputs)),
            *(
                Topic(
                    self._estimate_channels[method],
                    estimate_rows(samples, estimate, self._parameters),
                )
                for method, estimate in estimates.items()
            ),
            Topic(self._modes_channel, modes_rows(samples, modes)),
        ]
        log_ns = np.maximum.accumulate(np.maximum(samples.unix_ns, self._sample_ns))
        publish_ns = np.maximum(samples.received_us, 0) * 1000
        with os_errors_as_sink_error(self._part):
            for rows in self._parted(samples, log_ns):
                part = [Topic(topic.channel, topic.rows[rows]) for topic in topics]
                first = self._rows + rows.start
                self._writer.add_rows(part, log_ns[rows], publish_ns[rows], first)
        self._rows += len(samples)
        self._sample_ns = int(log_ns[-1])

    def _move(self, block: MotionBlock) -> None:
        """Add motion, which is written before the samples it is for.

        The first motion adds the channels: a file without motion does not have them.
        """
        with os_errors_as_sink_error(self._part):
            self._add_record("motion_units", units(self._grid.rudder_unit, MOTION_TABLE))
            for topic, *new in motion_messages(block):
                if topic not in self._motion_channels:
                    self._motion_channels[topic] = self._channel(topic)
                before = self._motion.get(topic)
                if before is not None:
                    new = [np.concatenate(each) for each in zip(before, new, strict=True)]
                self._motion[topic] = new[0], new[1]
            if any(len(rows) > _MOST_MOTION for _, rows in self._motion.values()):
                self._write_motion()

    def _write_motion(self, until_ns: int = _END_NS) -> None:
        """Write the motion that waits, up to a log time."""
        waiting, self._motion = self._motion, {}
        for topic, (log_ns, rows) in waiting.items():
            first = self._motion_rows.get(topic, 0)
            count = int(log_ns.searchsorted(until_ns, "right"))
            if count:
                now = Topic(self._motion_channels[topic], rows[:count])
                self._writer.add_rows([now], log_ns[:count], log_ns[:count], first)
                self._motion_rows[topic] = first + count
            if count < len(rows):
                self._motion[topic] = log_ns[count:], rows[count:]

    def _parted(self, samples: SampleBlock, log_ns: Ints) -> Iterator[slice]:
        """Write what comes before samples; yield the rows up to the next such place."""
        for rows in self._named_modes(samples, log_ns):
            first = rows.start
            while self._motion and first < rows.stop:
                stop = int(log_ns.searchsorted(log_ns[first] + CHUNK_NS))
                stop = min(max(stop, first + 1), rows.stop)
                self._write_motion(int(log_ns[stop - 1]))
                yield slice(first, stop)
                first = stop
            if first < rows.stop:
                yield slice(first, rows.stop)

    def _named_modes(self, samples: SampleBlock, log_ns: Ints) -> Iterator[slice]:
        """Write each change of flight mode; yield the rows from each change to the next."""
        known = np.nan_to_num(samples.mode, nan=-1.0)  # NaN would be a change at every row
        before = np.concatenate([[known[0] if self._mode is None else self._mode], known[:-1]])
        changed = known != before
        changed[0] |= self._mode is None
        starts = np.flatnonzero(changed).tolist()
        if not changed[0]:
            yield slice(0, starts[0] if starts else len(known))
        for row, stop in pairwise([*starts, len(known)]):
            boot_s, mode = samples.boot_us[row] / 1e6, float(samples.mode[row])
            message = mode_message(boot_s, mode, self._grid.mode_name(mode))
            now_ns = int(log_ns[row])
            if self._writer.would_end(now_ns, now_ns):
                self._writer.end_chunk()
            self._writer.add_message(self._mode_channel, now_ns, message)
            yield slice(row, stop)
        self._mode = float(known[-1])

    def _add_answer(self, topic: str, last_ns: int, message: bytes) -> None:
        """Add an answer; ``log_time`` is that of its last sample.

        The first one adds the channel: a file without manoeuvres does not have it.
        """
        self._write_waiting()
        with os_errors_as_sink_error(self._part):
            channel, newest_ns = self._answers.get(topic) or (self._channel(topic), 0)
            self._answers[topic] = channel, max(last_ns, newest_ns)
            # It has its own chunk: one shared with samples would reach back by seconds.
            self._writer.end_chunk()
            self._writer.add_message(channel, self._answers[topic][1], message)
            self._writer.end_chunk()

    def _log(self, line: LogLine) -> None:
        self._log_ns = max(line.unix_ns, self._log_ns)
        self._write_waiting()
        with os_errors_as_sink_error(self._part):
            message = log_message(line.unix_ns, line.level, line.text)
            self._writer.add_message(self._log_channel, self._log_ns, message)

    def _flush(self) -> None:
        if self._pace.due():
            self._write_waiting()
            with os_errors_as_sink_error(self._part):
                self._writer.end_chunk()
                self._disk.sync_soon(self._stream)

    def _finish(self, summary: RunSummary, attachments: Mapping[str, bytes]) -> None:
        """Write verdict, origin and attachments, then rename."""
        self._write_waiting()
        last_ns = max(self._sample_ns, self._log_ns)
        with os_errors_as_sink_error(self._part):
            self._write_motion()
            if summary.verdict is not None:
                verdict = verdict_message(summary.verdict)
                self._writer.add_message(self._verdict_channel, last_ns, verdict)
            if summary.flight is not None:
                verdict = verdict_message(summary.flight.verdict)
                self._writer.add_message(self._channel(FLIGHT), last_ns, verdict)
            if summary.ordinary is not None:
                schema = "yawid.Ordinary", "jsonschema", ordinary_schema()
                number = self._writer.register_schema(*schema)
                channel = self._writer.register_channel(ORDINARY_TOPIC, "json", number, {})
                data = json.dumps(summary.ordinary.to_json()).encode()
                self._writer.add_message(channel, last_ns, data)
            self._add_record("source", summary.own_source.to_json())
            objects = summary.to_json()
            for name in ("vehicle", "channels", "link"):
                self._add_record(name, objects.get(name, {}))
            for name, data in attachments.items():
                media_type = _MEDIA_TYPES.get(Path(name).suffix, "application/octet-stream")
                self._writer.add_attachment(last_ns, name, media_type, data)
            self._writer.finish()
            self._writer.close()
            self._disk.sync_now(self._stream)
        self._file.take_name(self.path)

    def _write_last(self) -> None:
        # The error that led to this call has been reported already.
        if not self._stream.closed:
            with contextlib.suppress(OSError, SinkError):
                self._write_waiting()
                self._write_motion()
            with contextlib.suppress(OSError):
                self._writer.finish()
        with contextlib.suppress(OSError):
            self._writer.close()

    def _open(self, metadata: Mapping[str, str | Mapping[str, object]]) -> None:
        with os_errors_as_sink_error(self._part):
            self._writer.start(LIBRARY)
            self._add_record("answers", {"form": FORM})
            for name, value in metadata.items():
                self._add_record(name, value)
            self._log_channel = self._channel(LOG)
            self._verdict_channel = self._channel(VERDICT)
            self._stream.flush()

    def _channel(self, topic: str, metadata: Mapping[str, str] | None = None) -> int:
        schema = TOPICS[topic]
        if schema not in self._schemas:
            self._schemas[schema] = self._writer.register_schema(
                schema, "protobuf", schema_data(schema, self._parameters)
            )
        return self._writer.register_channel(
            topic, "protobuf", self._schemas[schema], metadata or {}
        )

    def _add_record(self, name: str, value: str | Mapping[str, object]) -> None:
        """Write a metadata record, unless it is empty or its name has been written already."""
        if value and name not in self._records:
            self._records.add(name)
            self._writer.add_metadata(name, _as_record(value))
