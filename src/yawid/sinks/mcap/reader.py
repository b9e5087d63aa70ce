"""A finished run read from its MCAP file: its summary and settings, and its rows in blocks.

Rows are read where their schema is this version's, to the byte: any other is another format, which
is refused instead of being misread. Answers are read where their form is this version's: of a file
of another one there is only what came from its log, for a replay. Anybody may have written the
file: a wrong type or size is reported here in one line, and does not become an error in another
place.
"""

import math
import struct
import tomllib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO, Final, TypeAlias, get_args

import numpy as np
from google.protobuf.message import DecodeError
from google.protobuf.message_factory import GetMessageClass
from zstandard import ZstdError, frame_content_size

from mcap.exceptions import McapError
from mcap.reader import McapReader, NonSeekingReader, make_reader
from mcap.records import Channel, Chunk, Message, Schema
from mcap.stream_reader import StreamReader, get_chunk_data_stream
from yawid.answers.run_summary import FORM, RunSummary
from yawid.blocks import Ints, MotionBlock, SampleBlock, Status
from yawid.config.run import RunConfig
from yawid.config.settings import check_settings
from yawid.errors import SourceError
from yawid.estimation.polynomials import parameter_names
from yawid.sinks.base import Grid, LogLevel, LogLine, RunRows
from yawid.sinks.mcap.chunks import MAGIC
from yawid.sinks.mcap.messages import Rows, estimate_from, modes_from, samples_from
from yawid.sinks.mcap.motion_rows import motion_from
from yawid.sinks.mcap.protobuf_rows import RowLayout
from yawid.sinks.mcap.schemas import (
    LOG,
    MODES,
    MOTION,
    SAMPLE,
    descriptor,
    estimate_topics,
    is_ours,
    message_class,
    schema_data,
)

BLOCK_ROWS: Final = 8192
_LOG_LEVELS: Final = dict(enumerate(get_args(LogLevel), start=1)) | {5: "error"}  # 5: fatal
LARGEST_CHUNK: Final = 64 << 20
"""The largest unpacked chunk in bytes; yawid writes a chunk for each second."""
LARGEST_RATIO: Final = 200
"""The largest ratio of unpacked to packed bytes above a megabyte: Zstandard packs gigabytes of
zeros into almost nothing, and the library reads every nine of them as a record."""
LARGEST_SAMPLE: Final = 9e9
"""The largest value in a sample; some are seconds of Unix time and become integers in ns."""
DAMAGE: Final = (McapError, struct.error, ValueError, ZstdError, MemoryError, OverflowError)
"""Errors that mcap raises on damaged bytes: its own, short structs, bad text, absurd sizes."""
# The errors that all libraries in use raise on bytes of another kind than expected.
_DAMAGE: Final = (*DAMAGE, DecodeError, KeyError, TypeError, OSError)  # OSError: bad offsets


_REPLAY: Final = "replay its log again; yawid replay of this file reads what is left of it"
Waiting: TypeAlias = dict[str, tuple[list[int], list[bytes]]]
"""Log times and data of messages by topic."""


class DamagedError(SourceError):
    """A run's file was cut off or is damaged; its first samples may be there."""


@dataclass(slots=True)
class McapRun:
    """A run's file: its summary, metadata and settings; ``blocks`` and ``samples`` read its rows.

    ``grid`` is None where rudder and yaw rate never came together: such a run has no rows.
    """

    path: Path
    summary: RunSummary
    metadata: Mapping[str, Mapping[str, str]]
    attachments: Mapping[str, bytes]
    config: RunConfig
    grid: Grid | None
    log: list[LogLine] = field(default_factory=list)
    rows: int = 0
    has_motion: bool = False
    """Whether the run kept the lateral motion."""

    @property
    def is_of_this_form(self) -> bool:
        """Whether the summary has the run's answers; else only what came from the log."""
        return _is_of_this_form(self.metadata)

    def rates_hz(self, rudder: str) -> tuple[float, float] | None:
        """Return the rates in Hz of the messages of yaw and of ``rudder``, the input's name.

        A torn file has no rates: there the grid's rate stands for them, which is no higher
        than theirs. Without a grid the result is None.
        """
        if self.grid is None:
            return None
        least_hz, channels = 1.0 / self.grid.sample_time_s, self.summary.channels
        found = [channels.get("yaw"), channels.get(rudder)]
        rates = [(each and (each.first_rate_hz or each.rate_hz)) or least_hz for each in found]
        return rates[0], rates[1]

    def samples(self) -> Iterator[SampleBlock]:
        """Yield the samples without estimates and modes.

        Raises:
            SourceError: the file is damaged.
        """
        for rows, unix_ns in self._rows((SAMPLE,)):
            yield self._samples(rows[0], unix_ns)

    def samples_and_motion(self) -> Iterator[SampleBlock | MotionBlock]:
        """Yield the samples, and before them the lateral motion that they need.

        Each block of samples waits for the motion that was written with the next one.

        Raises:
            SourceError: the file is damaged.
        """
        waiting: Waiting = {topic: ([], []) for topic in MOTION}
        samples: SampleBlock | None = None
        for rows, unix_ns in self._rows((SAMPLE,), waiting):
            yield self._motion(waiting)
            if samples is not None:
                yield samples
            samples = self._samples(rows[0], unix_ns)
        yield self._motion(waiting)
        if samples is not None:
            yield samples

    def motion(self) -> MotionBlock | None:
        """Return all of the lateral motion, None where the run kept none.

        Raises:
            SourceError: the file is damaged.
        """
        if not self.has_motion:
            return None
        found = [each for each in self.samples_and_motion() if isinstance(each, MotionBlock)]
        return MotionBlock.joined(found) if found else None

    def _motion(self, waiting: Waiting) -> MotionBlock:
        with _damage_reported(self.path):
            motion = motion_from(waiting)
        waiting.update({topic: ([], []) for topic in MOTION})
        return motion

    def blocks(self) -> Iterator[RunRows]:
        """Yield samples with their estimates and modes.

        Raises:
            SourceError: the file is damaged.
        """
        topics = estimate_topics(() if self.grid is None else self.grid.methods)
        for rows, unix_ns in self._rows((SAMPLE, *topics.values(), MODES)):
            estimates = {m: estimate_from(r) for m, r in zip(topics, rows[1:-1], strict=True)}
            yield RunRows(self._samples(rows[0], unix_ns), estimates, modes_from(rows[-1]))

    def _samples(self, rows: Rows, unix_ns: Ints) -> SampleBlock:
        assert self.grid is not None  # without a grid there are no rows
        return samples_from(rows, unix_ns, self.grid.sample_time_s)

    def _messages(
        self, stream: BinaryIO, topics: list[str]
    ) -> Iterator[tuple[Schema | None, Channel, Message]]:
        """Yield the messages of these topics in the order of the file."""
        # The seeking reader would hold the whole file in memory in this order: a gigabyte for
        # five hours.
        reader = NonSeekingReader(stream, validate_crcs=True)
        return reader.iter_messages(topics, log_time_order=False)

    def _rows(
        self, topics: tuple[str, ...], others: Waiting | None = None
    ) -> Iterator[tuple[list[Rows], Ints]]:
        """Yield equally many messages of each topic, and the log times (n,) of the first topic.

        Messages of ``others`` are added there as they come.
        """
        others = {} if others is None else others
        if self.grid is None:
            return
        layouts: dict[str, RowLayout] = {}
        waiting: dict[str, list[bytes]] = {topic: [] for topic in topics}
        log_ns: list[int] = []
        with opened(self.path) as stream, _damage_reported(self.path):
            for schema, channel, message in self._messages(stream, [*topics, *others]):
                topic = channel.topic
                if schema is None:
                    raise ValueError(f"{topic} has no schema")
                if topic in others:
                    others[topic][0].append(message.log_time)
                    others[topic][1].append(message.data)
                    continue
                if topic not in layouts:
                    layouts[topic] = _layout(self.path, schema, self.grid.parameters, message.data)
                if topic == topics[0]:
                    if len(log_ns) == BLOCK_ROWS:
                        found = checked(_joined(layouts, waiting), self.grid)
                        yield found, np.array(log_ns, np.int64)
                        log_ns = []
                    log_ns.append(message.log_time)
                waiting[topic].append(message.data)
            if log_ns:
                yield checked(_joined(layouts, waiting), self.grid), np.array(log_ns, np.int64)


def open_run(path: Path) -> McapRun:
    """Open the file of a finished run and return all of it but its rows, which are read later.

    Raises:
        SourceError: it cannot be read, is not an MCAP file, was never finished, or is not yawid's.
    """
    with opened(path) as stream:
        if stream.read(len(MAGIC)) != MAGIC:
            raise SourceError(f"{path} is not an MCAP file: yawid replay makes one from a log")
        stream.seek(0)
        with _damage_reported(path):
            for record in StreamReader(stream, emit_chunks=True).records:
                if isinstance(record, Chunk):
                    if is_bomb(record):
                        raise SourceError(
                            f"{path}: one of its chunks unpacks to too much data, so it is not read"
                        )
                    get_chunk_data_stream(record, validate_crc=True)
            stream.seek(0)
            reader = make_reader(stream, validate_crcs=True)
            metadata = {record.name: record.metadata for record in reader.iter_metadata()}
            attachments = {record.name: record.data for record in reader.iter_attachments()}
            log = list(_log_lines(reader))
            contents = _contents(reader)
    if "configuration" not in metadata:
        raise SourceError(f"{path} is an MCAP file, but not of a yawid run")
    if "summary.json" not in attachments:
        raise DamagedError(f"{path} holds no summary, as its run was cut off: {_REPLAY}")
    try:
        is_whole = _is_of_this_form(metadata)
        summary = RunSummary.from_json(attachments["summary.json"], is_whole=is_whole)
        config = read_config(attachments.get("configuration.toml"))
        grid = read_grid(metadata.get("grid"), config)
    except ValueError as error:
        raise SourceError(f"{path} is not a file as yawid writes it: {error}") from error
    return McapRun(path, summary, metadata, attachments, config, grid, log, *contents)


def open_answered(path: Path) -> McapRun:
    """Open a run whose answer is to be used, as :func:`open_run` does.

    Raises:
        SourceError: as there, or the answer is one of another version.
    """
    run = open_run(path)
    if not run.is_of_this_form:
        raise SourceError(f"{path} is of another version of yawid: replay it first")
    return run


def _is_of_this_form(metadata: Mapping[str, Mapping[str, str]]) -> bool:
    return metadata.get("answers", {}).get("form") == FORM


def log_sha256_of(run: McapRun) -> str | None:
    """Return the hash of the log that a run is of, None where it was not read to its end."""
    return (run.summary.source or run.summary.own_source).sha256


def reading_of(run: McapRun) -> Mapping[str, str]:
    """Return how the log of a run was read, where that was not the usual way."""
    return run.metadata.get("reading", {})


@contextmanager
def _damage_reported(path: Path) -> Iterator[None]:
    """Turn the errors that libraries raise on damaged bytes into a SourceError of one line."""
    try:
        yield
    except _DAMAGE as error:
        reason = str(error).partition("\n")[0] or "it ends too early"
        raise DamagedError(
            f"{path} is damaged or was never finished ({reason}): {_REPLAY}"
        ) from error


def opened(path: Path) -> BinaryIO:
    """Open a file for reading.

    Raises:
        SourceError: it cannot be read.
    """
    try:
        return path.open("rb")
    except OSError as error:
        raise SourceError(f"cannot read {path}: {error.strerror}") from error


def _layout(path: Path, schema: Schema, parameters: tuple[str, ...], first: bytes) -> RowLayout:
    """Return the layout of a topic's rows; ``first`` is its first message.

    Repeated fields have the length that they have in the first message.

    Raises:
        SourceError: the file's schema is not that of this version.
    """
    if schema.data != schema_data(schema.name, parameters):
        raise SourceError(
            f"{path}: {schema.name} is of another version of yawid: replay the log itself"
        )
    known = descriptor(schema.name, parameters)
    message: Any = GetMessageClass(known)().FromString(first)
    lengths = {
        each.name: len(getattr(message, each.name)) for each in known.fields if each.is_repeated
    }
    return RowLayout(known, lengths)


def _joined(layouts: Mapping[str, RowLayout], waiting: dict[str, list[bytes]]) -> list[Rows]:
    """Return the rows (n,) of each topic and empty the lists of messages.

    Raises:
        ValueError: the topics differ in their number of messages, or those of one in size.
    """
    counts = {len(messages) for messages in waiting.values()}
    if len(counts) != 1:
        raise ValueError("some of its samples lack their estimates")
    rows = []
    for topic, messages in waiting.items():
        layout = layouts[topic]
        if any(len(message) != layout.size for message in messages):
            raise ValueError(f"messages of different sizes in {topic}")
        rows.append(np.frombuffer(b"".join(messages), layout.dtype))
        messages.clear()
    return rows


def _log_lines(reader: McapReader) -> Iterator[LogLine]:
    for _, _, message in reader.iter_messages([LOG]):
        line: Any = message_class("foxglove.Log").FromString(message.data)
        level = _LOG_LEVELS.get(line.level, "info")
        if message.log_time >= 2**63:
            raise ValueError("a log line has no time")
        yield LogLine(message.log_time, level, line.message)


def _contents(reader: McapReader) -> tuple[int, bool]:
    """Return the number of samples, and whether motion is there.

    Motion is attitudes and commands as this version writes them.
    """
    summary = reader.get_summary()
    if summary is None:
        return 0, False
    counts = {} if summary.statistics is None else summary.statistics.channel_message_counts
    rows = sum(counts.get(i, 0) for i, c in summary.channels.items() if c.topic == SAMPLE)
    found = set()
    for channel in summary.channels.values():
        schema = summary.schemas.get(channel.schema_id)
        if channel.topic in MOTION and schema is not None:
            found.add(channel.topic)
            if not is_ours(schema.name, schema.data):
                raise ValueError(f"{channel.topic} was written by another version of yawid")
    return rows, set(MOTION[:2]) <= found


def read_config(data: bytes | None) -> RunConfig:
    """Return the configuration that a file holds as TOML.

    Raises:
        ValueError: ``data`` is None, or this version cannot use it.
    """
    if data is None:
        raise ValueError("it holds no configuration")
    try:
        settings = tomllib.loads(data.decode())
        return RunConfig(**check_settings(settings, "configuration.toml"))
    except (ValueError, OverflowError, RecursionError) as error:
        raise ValueError(f"its configuration cannot be used: {error}") from error


def read_grid(record: Mapping[str, str] | None, config: RunConfig) -> Grid | None:
    """Return the grid in a file's metadata, None where the run had none.

    Raises:
        ValueError: the grid makes no sense, or is not that of the configuration.
    """
    if record is None:
        return None
    try:
        parameters, inputs, methods = (
            tuple(record[name].split()) for name in ("parameters", "inputs", "methods")
        )
        autopilot, kind = (int(record[name]) for name in ("autopilot", "vehicle_type"))
        unit, sample_time_s = config.unit_of_rudder, float(record["sample_time_s"])
        grid = Grid(parameters, inputs, methods, sample_time_s, unit, autopilot, kind)
    except (KeyError, ValueError) as error:
        raise ValueError(f"its grid cannot be read: {error!r}") from error
    names = parameter_names(config.armax_orders(), config.inputs, bias=True)
    if (parameters, inputs, methods) != (names, config.inputs, config.bank_methods()):
        raise ValueError("its grid is not that of its configuration")
    if not 1e-6 < grid.sample_time_s < math.inf:
        raise ValueError(f"its sample time of {grid.sample_time_s!r} s is impossible")
    return grid


def checked(found: list[Rows], grid: Grid) -> list[Rows]:
    """Check the rows (n,) of several topics, the samples first, and return them.

    Raises:
        ValueError: their columns are not those of the grid, or they hold values no run writes.
    """
    p = len(grid.parameters)
    widths = {"u": len(grid.inputs), "theta": p, "theta_std": p}
    for rows in found:
        names = set(rows.dtype.names or ())
        if any(rows[name].shape[1] != widths[name] for name in widths.keys() & names):
            raise ValueError("a message has other columns than the grid says")
        if "status" in names and rows["status"].max() > max(Status):
            raise ValueError("an estimator has an unknown status")
    samples = found[0]
    for name in samples.dtype.names or ():
        if samples[name].dtype.kind == "f":
            sound = np.abs(samples[name]) < LARGEST_SAMPLE
            if not np.all(sound if name.endswith("_time") else sound | np.isnan(samples[name])):
                raise ValueError(f"{name} of a sample is impossible")
    return found


def is_bomb(chunk: Chunk) -> bool:
    """Return whether a chunk unpacks to far more than its size, as one made to attack a reader.

    Raises:
        ZstdError: its content is not a Zstandard frame.
    """
    unpacked = chunk.uncompressed_size
    if chunk.compression == "zstd":
        unpacked = max(unpacked, frame_content_size(chunk.data))
    return unpacked > min(LARGEST_CHUNK, max(1 << 20, LARGEST_RATIO * len(chunk.data)))
