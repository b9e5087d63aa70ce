"""A run read from its MCAP file: its summary and settings, and its rows in blocks.

Rows are read where their schema is this version's, to the byte: any other is another format, which
is refused instead of being misread. Answers are read where their form is this version's: of a file
of another one there is only what came from its log, for a replay. Of a file that was cut off there
are the seconds before its first bad record. Anybody may have written the file: a wrong type or size
is reported here in one line, and does not become an error in another place.
"""

import json
import math
import tomllib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, TypeAlias, get_args

import numpy as np
from google.protobuf.message import DecodeError

from mcap.reader import McapReader, make_reader
from mcap.records import Chunk, Metadata, Schema
from mcap.stream_reader import StreamReader, get_chunk_data_stream
from yawid.answers.heard import LinkCounts
from yawid.answers.reasons import Reason, Verdict
from yawid.answers.run_summary import FORM, RunSummary
from yawid.blocks import Ints, MotionBlock, SampleBlock, Status
from yawid.config.run import RunConfig
from yawid.config.settings import check_settings
from yawid.errors import SourceError
from yawid.estimation.polynomials import parameter_names
from yawid.sinks.base import Grid, LogLevel, LogLine, RunRows
from yawid.sinks.mcap.chunks import MAGIC
from yawid.sinks.mcap.messages import (
    RowLayout,
    Rows,
    estimate_from,
    modes_from,
    motion_from,
    samples_from,
)
from yawid.sinks.mcap.records import DAMAGE, intact, is_bomb, opened, records
from yawid.sinks.mcap.schemas import (
    LOG,
    MODES,
    MOTION,
    SAMPLE,
    TOPICS,
    descriptor,
    estimate_topics,
    message_class,
    schema_data,
)

BLOCK_ROWS: Final = 8192
_LOG_LEVELS: Final = dict(enumerate(get_args(LogLevel), start=1)) | {5: "error"}  # 5: fatal
LARGEST_SAMPLE: Final = 9e9
"""The largest value in a sample; some are seconds of Unix time and become integers in ns."""
# The errors that all libraries in use raise on bytes of another kind than expected.
_DAMAGE: Final = (*DAMAGE, DecodeError, TypeError, OSError)  # OSError: bad offsets
_REPLAY: Final = "replay its log again; yawid replay of this file reads what is left of it"
Found: TypeAlias = dict[str, tuple[Rows, Ints]]
"""The rows (n,) of each topic and their log times (n,)."""


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
    is_torn: bool = False
    """Whether it was cut off or is damaged: only what is before the first bad record is read."""

    @property
    def is_of_this_form(self) -> bool:
        """Whether the summary has the run's answers; else only what came from the log."""
        return self.metadata.get("answers", {}).get("form") == FORM

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
        for found in self._rows(SAMPLE):
            yield self._samples(found)

    def samples_and_motion(self) -> Iterator[SampleBlock | MotionBlock]:
        """Yield the samples, and before them the lateral motion that they need.

        Each block of samples waits for the motion that was written with the next one.

        Raises:
            SourceError: the file is damaged.
        """
        samples: SampleBlock | None = None
        for found in self._rows(SAMPLE, *MOTION):
            with _damage_reported(self.path):
                yield MotionBlock(*(motion_from(topic, *found[topic]) for topic in MOTION))
            if samples is not None:
                yield samples
            samples = self._samples(found)
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

    def blocks(self) -> Iterator[RunRows]:
        """Yield samples with their estimates and modes.

        Raises:
            SourceError: the file is damaged.
        """
        topics = estimate_topics(() if self.grid is None else self.grid.methods)
        for found in self._rows(SAMPLE, *topics.values(), MODES):
            estimates = {method: estimate_from(found[topic][0]) for method, topic in topics.items()}
            yield RunRows(self._samples(found), estimates, modes_from(found[MODES][0]))

    def _samples(self, found: Found) -> SampleBlock:
        assert self.grid is not None  # without a grid there are no rows
        return samples_from(*found[SAMPLE], self.grid.sample_time_s)

    def _rows(self, *topics: str) -> Iterator[Found]:
        """Yield the rows of these topics, some chunks at once, and at last all that are left."""
        if self.grid is None:
            return
        layouts: dict[str, RowLayout] = {}
        found: dict[str, list[tuple[int, bytes]]] = {topic: [] for topic in topics}
        with opened(self.path) as stream, _damage_reported(self.path):
            for part in (intact if self.is_torn else records)(stream):
                if isinstance(part, Metadata):
                    continue
                for schema, channel, message in part:
                    if (topic := channel.topic) in found:
                        if topic not in layouts:
                            layouts[topic] = self._layout(schema, message.data)
                        found[topic].append((message.log_time, message.data))
                counts = {len(each) for topic, each in found.items() if topic not in MOTION}
                if min(counts) >= BLOCK_ROWS and len(counts) == 1:
                    yield self._taken(layouts, found)
            yield self._taken(layouts, found)

    def _taken(
        self, layouts: Mapping[str, RowLayout], messages: dict[str, list[tuple[int, bytes]]]
    ) -> Found:
        """Return the rows of the messages, which are no longer kept.

        Raises:
            ValueError: they are not as a run writes them.
        """
        assert self.grid is not None
        found = {}
        for topic, each in messages.items():
            layout = layouts.get(topic) or RowLayout(descriptor(TOPICS[topic]), {"u": 1})
            times = np.array([time for time, _ in each], np.int64)
            found[topic] = layout.read([data for _, data in each]), times
            each.clear()
        check(found, self.grid)
        return found

    def _layout(self, schema: Schema, first: bytes) -> RowLayout:
        """Return the layout of a topic's rows; ``first`` is its first message.

        Repeated fields have the length that they have in the first message.

        Raises:
            SourceError: the file's schema is not that of this version.
        """
        parameters = () if self.grid is None else self.grid.parameters
        if schema.data != schema_data(schema.name, parameters):
            raise SourceError(
                f"{self.path}: {schema.name} is of another version of yawid: replay the log itself"
            )
        message: Any = message_class(schema.name, parameters).FromString(first)
        repeated = [each.name for each in message.DESCRIPTOR.fields if each.is_repeated]
        lengths = {name: len(getattr(message, name)) for name in repeated}
        return RowLayout(message.DESCRIPTOR, lengths)


def open_run(path: Path, *, head: bool = False) -> McapRun:
    """Open the file of a finished run and return all of it but its rows, which are read later.

    With ``head`` it is for its options and summary alone: its chunks are neither checked nor read.

    Raises:
        SourceError: it cannot be read, is not an MCAP file, was never finished, or is not yawid's.
    """
    with opened(path) as stream:
        if stream.read(len(MAGIC)) != MAGIC:
            raise SourceError(f"{path} is not an MCAP file: yawid replay makes one from a log")
        stream.seek(0)
        with _damage_reported(path):
            for record in () if head else StreamReader(stream, emit_chunks=True).records:
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
            log = [] if head else list(_log_lines(reader))
            contents = _contents(reader)
    if "configuration" not in metadata:
        raise SourceError(f"{path} is an MCAP file, but not of a yawid run")
    if "summary.json" not in attachments:
        raise DamagedError(f"{path} holds no summary, as its run was cut off: {_REPLAY}")
    try:
        is_whole = metadata.get("answers", {}).get("form") == FORM
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


def _log_lines(reader: McapReader) -> Iterator[LogLine]:
    for _, _, message in reader.iter_messages([LOG]):
        line: Any = message_class("foxglove.Log").FromString(message.data)
        level = _LOG_LEVELS.get(line.level, "info")
        if message.log_time >= 2**63:
            raise ValueError("a log line has no time")
        yield LogLine(message.log_time, level, line.message)


def _contents(reader: McapReader) -> tuple[int, bool]:
    """Return the number of samples, and whether motion, attitudes and commands, is there."""
    summary = reader.get_summary()
    if summary is None:
        return 0, False
    counts = {} if summary.statistics is None else summary.statistics.channel_message_counts
    rows = sum(counts.get(i, 0) for i, c in summary.channels.items() if c.topic == SAMPLE)
    return rows, set(MOTION[:2]) <= {channel.topic for channel in summary.channels.values()}


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
    names = parameter_names(config.armax_orders(), config.inputs, bias=True)
    methods = config.bank_methods()
    said = {"parameters": names, "inputs": config.inputs, "methods": methods}
    try:
        if any(record[name].split() != list(each) for name, each in said.items()):
            raise ValueError("its grid is not that of its configuration")
        autopilot, kind = (int(record[name]) for name in ("autopilot", "vehicle_type"))
        unit, sample_time_s = config.unit_of_rudder, float(record["sample_time_s"])
        grid = Grid(names, config.inputs, methods, sample_time_s, unit, autopilot, kind)
    except KeyError as error:
        raise ValueError(f"its grid lacks {error}") from error
    if not 1e-6 < grid.sample_time_s < math.inf:
        raise ValueError(f"its sample time of {grid.sample_time_s!r} s is impossible")
    return grid


def check(found: Found, grid: Grid) -> None:
    """Check the rows of samples, and of estimates and modes if they are there.

    Raises:
        ValueError: their columns are not those of the grid, or they hold values no run writes.
    """
    p, samples = len(grid.parameters), found[SAMPLE][0]
    widths = {"u": len(grid.inputs), "theta": p, "theta_std": p}
    for rows in (
        rows for topic, (rows, _) in found.items() if topic not in MOTION and len(samples)
    ):
        names = set(rows.dtype.names or ())
        if len(rows) != len(samples):
            raise ValueError("some of its samples lack their estimates")
        if any(rows[name].shape[1] != widths[name] for name in widths.keys() & names):
            raise ValueError("a message has other columns than the grid says")
        if "status" in names and rows["status"].max() > max(Status):
            raise ValueError("an estimator has an unknown status")
    for name in samples.dtype.names or ():
        if samples[name].dtype.kind == "f":
            sound = np.abs(samples[name]) < LARGEST_SAMPLE
            if not np.all(sound if name.endswith("_time") else sound | np.isnan(samples[name])):
                raise ValueError(f"{name} of a sample is impossible")


def open_torn(path: Path, why: SourceError) -> McapRun:
    """Return what a file that cannot be read as a whole has, without a judgement of its link.

    Raises:
        SourceError: ``why`` it cannot be read, where no sample comes before the first bad record.
    """
    metadata: dict[str, dict[str, str]] = {}
    topics: set[str] = set()
    times_ns: list[int] = []
    with opened(path) as stream:
        for found in intact(stream):
            if isinstance(found, Metadata):
                metadata.setdefault(found.name, found.metadata)
                continue
            topics |= {channel.topic for _, channel, _ in found}
            times_ns += [m.log_time for _, channel, m in found if channel.topic == SAMPLE]
    try:
        texts = {name: _value(text) for name, text in metadata["configuration"].items()}
        given = {name: value for name, value in texts.items() if value is not None}
        config = RunConfig(**check_settings(given, "configuration"))
        grid = read_grid(metadata.get("grid"), config)
    except (ValueError, OverflowError, RecursionError, KeyError, TypeError):
        raise why from None
    if not times_ns:
        raise why
    rows, seconds = len(times_ns), (times_ns[-1] - times_ns[0]) / 1e9
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
    return McapRun(path, summary, metadata, {}, config, grid, [], rows, motion, is_torn=True)


def _value(text: str) -> Any:
    """Return a setting from its text in the metadata, which is JSON or the setting itself."""
    try:
        return json.loads(text)
    except ValueError:
        return text
