"""How a run is composed: a source (a log or a finished run), a pipeline, sinks, a summary.

source = open_log(path)
config = source.settled(settings)
summary = run(source, config, sinks).conclude()
"""

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from yawid.answers.heard import BootSpan
from yawid.answers.run_summary import ChannelFound, RunSummary
from yawid.blocks import SampleBlock
from yawid.channels.stage import WANTED
from yawid.channels.survey import Survey
from yawid.config.run import BOTH, OF_RECORDS, RunConfig
from yawid.errors import ConfigError
from yawid.pipeline import Pipeline
from yawid.results.summary import summarise
from yawid.runs.outputs import parameters_of
from yawid.runs.stop import Interrupted, StopFlag
from yawid.sinks.base import Event, LogLine, RunRows, Sink
from yawid.sources.formats import RUN, format_of
from yawid.sources.open_log import InMemory, Log, ReadOptions

if TYPE_CHECKING:
    from yawid.runs.finished_run import FinishedRun


class RecordedLog(Log):
    """A log opened for the messages that the channels read.

    ``modes_of`` holds the autopilot and the vehicle type, ``log_lines`` the messages that a run
    printed for its user: only a finished run knows these two before it is read.

    Raises:
        SourceError: there is no such file, it cannot be read, or it is not a log.
    """

    modes_of = (0, 0)
    of_file: tuple[ChannelFound | None, list[BootSpan] | None] = (None, None)
    log_lines: tuple[LogLine, ...] = ()

    def __init__(self, path: Path, options: ReadOptions | None = None) -> None:
        super().__init__(path, WANTED, options)

    def settled(self, settings: Mapping[str, Any]) -> RunConfig:
        """Return the configuration; for a record, with the rudder's unit, sign and travel in it.

        Raises:
            ConfigError: an option is missing, does not fit, or is for another kind of file.
            ChannelError: the record has no time, rudder or yaw rate.
            SourceError: a cell of the record is not understood.
        """
        config, record = RunConfig(**settings), self.record
        if record is None:
            for name in OF_RECORDS:
                if getattr(config, name):
                    option = name.replace("_", "-")
                    raise ConfigError(
                        f"--{option} is for CSV and Parquet, and {self.path} is a log"
                    )
            return config
        for name in BOTH:
            if getattr(config, name) != "auto":
                raise ConfigError(
                    f"--{name} {getattr(config, name)}: {self.path} has columns instead of "
                    f"channels: name one by --columns {name}=COLUMN"
                )
        needs = [*config.inputs[1:]]
        needs += ["yaw"] if config.output == "yaw" else []
        sign = config.rudder_sign if config.binds("rudder_sign") else None
        said = config.columns, config.units, config.rudder_unit, sign, config.rudder_max_deg
        from yawid.sources.records.find_columns import Asked  # only records need it

        found = record.settle(Asked(*said, tuple(needs), config.rudder_is, config.asks_motion))
        return replace(
            config,
            rudder_unit=found.rudder_unit,
            rudder_sign=found.rudder_sign,
            rudder_max_deg=found.rudder_max_deg,
            rudder_stroke_rad=found.stroke_rad,
            rudder_is=found.rudder_is,
        )

    def rates_hz(self, rudder: str) -> None:
        """Return None: the rates of a log are measured from its messages."""

    def left_open(self, pipeline: Pipeline) -> list[str]:
        """Return warnings: --from and --to cut several boots, signatures were not checked."""
        boots = pipeline.channels.boots.warning(pipeline.config)
        return [said for said in (boots, self.options.unchecked(self.link)) if said is not None]

    def parameters(self, pipeline: Pipeline) -> bytes:
        """Return the vehicle's parameters that were seen, as text; see :func:`parameters_of`."""
        return parameters_of(pipeline)

    @property
    def reading(self) -> dict[str, str]:
        """How the log is read, where that is not the usual way."""
        return {} if self.options.key is None else {"frames": "signed ones only"}

    def log_sha256(self) -> str:
        """Return the hash of the log before it is read."""
        with self._file.open("rb") as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest()

    def conclude(self, pipeline: Pipeline, *, is_whole: bool) -> RunSummary:
        """Return the summary of what was read."""
        return summarise(pipeline, self.link, str(self.path.absolute()), self.sha256)


Recording: TypeAlias = "RecordedLog | FinishedRun"
"""What can be replayed. Both kinds settle a configuration, yield blocks and conclude."""


def open_log(path: Path, options: ReadOptions | None = None) -> Recording:
    """Open a log or a finished run, recognised by its first bytes.

    Raises:
        SourceError: there is no such file, it cannot be read, or it is not a log.
    """
    if format_of(path) is not RUN:
        return RecordedLog(path, options)
    from yawid.runs.finished_run import FinishedRun  # logs do not need it

    return FinishedRun(path)


@dataclass(frozen=True, slots=True)
class Job:
    """A source that a pipeline has read: ``read`` bytes of it, ``is_whole`` where that is all."""

    source: Recording
    pipeline: Pipeline
    read: int
    is_whole: bool

    def conclude(self) -> RunSummary:
        """Return the summary; see :meth:`RecordedLog.conclude`."""
        return self.source.conclude(self.pipeline, is_whole=self.is_whole)


def run(
    source: Recording,
    config: RunConfig,
    sinks: Sequence[Sink] = (),
    stop: StopFlag | None = None,
    advance: Callable[[int], None] = lambda size: None,
    survey: Survey | None = None,
) -> Job:
    """Run a source through a pipeline; the sinks stay open. ``survey`` is given all messages.

    Raises:
        Interrupted: ``stop`` was set before anything was read.
        SourceError, ConfigError, SinkError: as :func:`feed_all`.
    """
    rates_hz = source.rates_hz(config.inputs[0])
    pipeline = Pipeline(
        config, sinks, modes_of=source.modes_of, rates_hz=rates_hz, of_file=source.of_file
    )
    if survey is not None:
        pipeline.channels.watch = survey.note
    read, is_whole = feed_all(source, pipeline, stop, advance)
    if stop is not None and not is_whole and read == 0:
        raise Interrupted(stop.exit_code)
    return Job(source, pipeline, read, is_whole)


def feed_all(
    source: "Recording | InMemory",
    pipeline: Pipeline,
    stop: StopFlag | None = None,
    advance: Callable[[int], None] = lambda size: None,
) -> tuple[int, bool]:
    """Run a source through a pipeline; return the bytes read, and whether they are all of it.

    The sinks stay open. When ``stop`` is set, reading ends before the next piece; ``advance`` is
    called with the size of each piece in bytes.

    Raises:
        SourceError: the source cannot be read.
        ConfigError: what is asked for does not fit the source.
        SinkError: a sink cannot write.
    """
    read, is_whole = 0, True
    for size, block in source.read():
        if size and stop is not None and stop.is_set:
            is_whole = False
            break
        pipeline.feed(block)
        read += size
        advance(size)
    pipeline.finish()
    if is_whole:
        pipeline.channels.boots.check(pipeline.config)
    return read, is_whole


class KeptSamples(Sink):
    """A sink that keeps the samples, for methods that need the whole record."""

    def __init__(self) -> None:
        self._blocks: list[SampleBlock] = []

    def take(self, event: Event) -> None:
        """See :class:`Sink`."""
        if isinstance(event, RunRows):
            self._blocks.append(event.samples)

    def joined(self) -> SampleBlock | None:
        """Return all samples as one block, None where there is no sample."""
        return SampleBlock.joined(self._blocks) if self._blocks else None
