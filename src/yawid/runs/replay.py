"""One replay, from a log or a finished run to its files."""

from __future__ import annotations

import sys
from contextlib import closing
from pathlib import Path
from typing import Protocol

from msgspec.structs import replace

from yawid.config.run import RunConfig
from yawid.pipeline import Pipeline
from yawid.results.reasons import Reason, Verdict
from yawid.results.run_summary import RunSummary
from yawid.results.summary import as_summary, summarise
from yawid.runs.choose_orders import with_orders
from yawid.runs.outputs import (
    Outputs,
    finish,
    keep_as_interrupted,
    open_sinks,
    parameters_of,
    whole_or_none,
)
from yawid.runs.run_log import open_log, run_log
from yawid.runs.stop import Interrupted
from yawid.runs.stop import StopFlag as StopFlag  # and who replays by Python finds it here
from yawid.sinks.mcap.reader import LogLine
from yawid.sinks.terminal.progress import progress
from yawid.sources.open_log import Log, ReadOptions, Source


class Origin(Protocol):
    """What is replayed: where its blocks come from, and what is to be said when they have."""

    @property
    def path(self) -> Path:
        """The file."""

    @property
    def source(self) -> Source:
        """The file, opened for reading."""

    @property
    def modes_of(self) -> tuple[int, int]:
        """Autopilot and vehicle type, where the source has no HEARTBEAT; else zeros."""

    def conclude(self, pipeline: Pipeline, *, is_whole: bool) -> tuple[RunSummary, Verdict]:
        """Return the summary and the verdict of the pipeline that has had what was read."""

    def parameters(self, pipeline: Pipeline) -> bytes:
        """Return the vehicle's parameters, as they are attached to a run's file."""

    def log_lines(self) -> list[LogLine]:
        """Return lines for people that were written when the samples were made."""


class LogOrigin:
    """A log, replayed for the first time."""

    modes_of = (0, 0)

    def __init__(self, source: Log) -> None:
        self.source, self.path = source, source.path

    def conclude(self, pipeline: Pipeline, *, is_whole: bool) -> tuple[RunSummary, Verdict]:
        """See :class:`Origin`."""
        boots, link = pipeline.channels.boots, self.source.link
        for said in (boots.warning(pipeline.config), self.source.options.unchecked(link)):
            if said is not None:
                sys.stderr.write(f"yawid: {said}\n")
        return summarise(pipeline, link, str(self.path.absolute()), self.source.sha256)

    def parameters(self, pipeline: Pipeline) -> bytes:
        """See :class:`Origin`."""
        return parameters_of(pipeline)

    def log_lines(self) -> list[LogLine]:
        """See :class:`Origin`."""
        return []


def replay(
    log: Path,
    config: RunConfig,
    outputs: Outputs,
    stop: StopFlag,
    read_options: ReadOptions | None = None,
    *,
    automatic: bool = False,
) -> tuple[RunSummary, Verdict]:
    """Replay one log; return its summary and verdict; ``automatic`` chooses the orders by the log.

    Told to ``stop`` it keeps what it has read, by names and with a verdict that say so.

    Raises:
        Interrupted: told to stop before there was anything to keep.
        SourceError: the log cannot be read.
        SinkError: an output cannot be written.
        ConfigError: what is asked for does not fit the log.
    """
    with stop.raising():
        source = open_log(log, read_options, again=automatic)
    with closing(source):
        if automatic:
            with stop.raising():
                config = with_orders(source, config)
        return to_files(LogOrigin(source), config, outputs, stop)


def to_files(
    origin: Origin, config: RunConfig, outputs: Outputs, stop: StopFlag
) -> tuple[RunSummary, Verdict]:
    """Run what is replayed to its files; return the summary and the verdict.

    Raises:
        Interrupted, SourceError, SinkError, ConfigError: as :func:`replay`.
    """
    sinks = open_sinks(config, outputs)
    pipeline = Pipeline(config, sinks, modes_of=origin.modes_of)
    total = origin.source.size
    with whole_or_none(sinks):
        with progress(sys.stderr, origin.path.name, total) as advance:
            read, is_whole = run_log(origin.source, pipeline, stop, advance)
        if not is_whole and read == 0:
            raise Interrupted(stop.exit_code)
        summary, verdict = origin.conclude(pipeline, is_whole=is_whole)
        files = outputs.files()
        if not is_whole:
            summary, verdict = _cut_short(summary, verdict, stop.name, (read, total))
            files = keep_as_interrupted(sinks, outputs)
        for sink in sinks:
            for line in origin.log_lines():
                sink.log(line.unix_ns, line.level, line.text)
        summary = finish(pipeline, summary, files, origin.parameters(pipeline))
    return summary, verdict


def _cut_short(
    summary: RunSummary, verdict: Verdict, signal: str, read_bytes: tuple[int, int]
) -> tuple[RunSummary, Verdict]:
    """Return summary and verdict of a run that a signal ended: a part of a log answers for no log.

    ``read_bytes`` are those read and those there are; there is no hash of the log.
    """
    read, total = read_bytes
    text = f"{signal} after {read / 1e6:.1f} of {total / 1e6:.1f} MB: what follows was not read"
    verdict = Verdict.of([Reason("interrupted", text), *verdict.reasons], verdict.method)
    told = replace(summary, sha256=None, bytes_read=read, verdict=as_summary(verdict))
    return told, verdict
