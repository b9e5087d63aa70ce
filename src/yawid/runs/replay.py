"""The replay of one log or finished run to its output files."""

import sys
from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import replace
from typing import Any

import msgspec

from yawid.answers.reasons import Reason
from yawid.answers.run_summary import RunSummary
from yawid.config.run import RunConfig
from yawid.errors import SinkError, UnwrittenError
from yawid.runs.job import Recording, open_log, run
from yawid.runs.outputs import (
    Outputs,
    among_files,
    finish,
    keep_as_interrupted,
    open_sinks,
    refused,
    whole_or_none,
)
from yawid.runs.stop import StopFlag as StopFlag  # a user of replay() needs it and finds it here
from yawid.sinks.base import Sink
from yawid.sinks.door import say
from yawid.sinks.terminal.progress import progress
from yawid.sources.open_log import ReadOptions
from yawid.system.stores import Place, brought


def replay(
    log: Place,
    settings: Mapping[str, Any],
    outputs: Outputs,
    stop: StopFlag,
    read_options: ReadOptions | None = None,
) -> RunSummary:
    """Replay one log or finished run; return its summary.

    ``settings`` are the fields of :class:`RunConfig` that the user gave; they overrule those of a
    finished run. When ``stop`` is set, what has been read is kept: the names of the files and the
    verdict report the interruption.

    Raises:
        Interrupted: ``stop`` was set before there was anything to keep.
        SourceError: the log cannot be read.
        SinkError: an output cannot be written.
        UnwrittenError: the same, or it may not be overwritten, which shows after the answer.
        ConfigError: what is asked for does not fit the log.
    """
    with ExitStack() as stack:
        with stop.raising():
            local = stack.enter_context(brought(log))
            source = open_log(local, read_options)
        source.path = log
        with stop.raising():
            config = source.settled(settings)
        outputs, why_not = among_files(outputs, config, source, local)
        if why_not is None:
            return to_files(source, config, outputs, stop)
        summary = to_files(source, config, replace(outputs, sink=Sink()), stop)
        raise UnwrittenError(why_not, summary)


def to_files(source: Recording, config: RunConfig, outputs: Outputs, stop: StopFlag) -> RunSummary:
    """Run a source and write its files; return the summary.

    Raises:
        Interrupted, SourceError, SinkError, UnwrittenError, ConfigError: as :func:`replay`.
    """
    sinks = open_sinks(config, outputs)
    with whole_or_none(sinks):
        with progress(sys.stderr, source.path.name, source.size) as advance:
            job = run(source, config, sinks, stop, advance)
        for said in source.left_open(job.pipeline):
            say(said)
        summary = job.conclude()
        files = outputs.files()
        if not job.is_whole:
            summary = _cut_short(summary, stop.name, job.read, source.size)
        try:
            if not job.is_whole:
                files = keep_as_interrupted(sinks, outputs)
            for line in source.log_lines:
                job.pipeline.pass_on(line)
            return finish(job.pipeline, summary, files, source.parameters(job.pipeline))
        except SinkError as error:
            raise UnwrittenError(str(error), summary) from error


def _cut_short(summary: RunSummary, signal: str, read: int, total: int) -> RunSummary:
    """Return the summary of a run that a signal ended, as not usable.

    ``read`` bytes of ``total`` were read of the log, whose hash is not known.
    """
    text = f"{signal} after {read / 1e6:.1f} of {total / 1e6:.1f} MB: the rest was not read"
    part = msgspec.structs.replace(summary, sha256=None, bytes_read=read)
    return refused(part, Reason("interrupted", text))
