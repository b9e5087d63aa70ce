"""One replay, from a log or a finished run to its files."""

import sys
from collections.abc import Callable
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from msgspec.structs import replace

from yawid.config.run import RunConfig
from yawid.pipeline import Pipeline
from yawid.results.reasons import Reason, Verdict
from yawid.results.run_summary import RunSummary
from yawid.results.summary import summarise
from yawid.runs.outputs import (
    Outputs,
    finish,
    keep_as_interrupted,
    open_sinks,
    parameters_of,
    refused,
    whole_or_none,
)
from yawid.runs.run_log import open_log, run_log, settled
from yawid.runs.stop import Interrupted
from yawid.runs.stop import StopFlag as StopFlag  # and who replays by Python finds it here
from yawid.sinks.door import say
from yawid.sinks.terminal.progress import progress
from yawid.sources.open_log import Log, ReadOptions, Source

if TYPE_CHECKING:
    from yawid.sinks.mcap.reader import McapRun

Conclude = Callable[[Pipeline, bool], tuple[RunSummary, Verdict]]
"""From a pipeline that has had what was read, and whether that is all, to its summary."""


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
        config = settled(source, config)
        if automatic:
            from yawid.runs.choose_orders import with_orders  # few ask for it

            with stop.raising():
                config = with_orders(source, config)
        return to_files(source, log, config, outputs, stop, partial(_conclude, source))


def _conclude(source: Log, pipeline: Pipeline, is_whole: bool) -> tuple[RunSummary, Verdict]:
    """Warn of what a log leaves open, and return its summary and verdict."""
    boots, link = pipeline.channels.boots, source.link
    for said in (boots.warning(pipeline.config), source.options.unchecked(link)):
        if said is not None:
            say(said)
    return summarise(pipeline, link, str(source.path.absolute()), source.sha256)


def to_files(
    source: Source,
    path: Path,
    config: RunConfig,
    outputs: Outputs,
    stop: StopFlag,
    conclude: Conclude,
    run: "McapRun | None" = None,
) -> tuple[RunSummary, Verdict]:
    """Run a source at ``path`` to its files; return the summary and the verdict.

    Of a finished ``run`` the flight modes' names, the parameters and the log lines are taken over.

    Raises:
        Interrupted, SourceError, SinkError, ConfigError: as :func:`replay`.
    """
    sinks = open_sinks(config, outputs)
    grid = None if run is None else run.grid
    modes_of = (0, 0) if grid is None else (grid.autopilot, grid.vehicle_type)
    rates_hz = None if run is None else run.rates_hz(config.inputs[0])
    pipeline = Pipeline(config, sinks, modes_of=modes_of, rates_hz=rates_hz)
    with whole_or_none(sinks):
        with progress(sys.stderr, path.name, source.size) as advance:
            read, is_whole = run_log(source, pipeline, stop, advance)
        if not is_whole and read == 0:
            raise Interrupted(stop.exit_code)
        summary, verdict = conclude(pipeline, is_whole)
        files = outputs.files()
        if not is_whole:
            summary, verdict = _cut_short(summary, verdict, stop.name, (read, source.size))
            files = keep_as_interrupted(sinks, outputs)
        for sink in sinks:
            for line in () if run is None else run.log:
                sink.log(line.unix_ns, line.level, line.text)
        known = parameters_of(pipeline)
        if run is not None:
            known = run.attachments.get("parameters.txt", b"")
        summary = finish(pipeline, summary, files, known)
    return summary, verdict


def _cut_short(
    summary: RunSummary, verdict: Verdict, signal: str, read_bytes: tuple[int, int]
) -> tuple[RunSummary, Verdict]:
    """Return summary and verdict of a run that a signal ended: a part of a log answers for no log.

    ``read_bytes`` are those read and those there are; there is no hash of the log.
    """
    read, total = read_bytes
    text = f"{signal} after {read / 1e6:.1f} of {total / 1e6:.1f} MB: what follows was not read"
    part = replace(summary, sha256=None, bytes_read=read)
    return refused(part, verdict, Reason("interrupted", text))
