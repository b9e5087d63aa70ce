"""One replay, from the log to its finished files."""

from __future__ import annotations

import hashlib
import sys
from pathlib import Path
from typing import Any

from yawid.config.run import RunConfig
from yawid.pipeline import Pipeline
from yawid.results.reasons import Reason, Verdict
from yawid.results.summary import as_summary, summarise
from yawid.runs.outputs import Outputs, finish, keep_as_interrupted, open_sinks, whole_or_none
from yawid.runs.stop import Interrupted
from yawid.runs.stop import StopFlag as StopFlag  # and who replays by Python finds it here
from yawid.sinks.terminal.progress import progress
from yawid.sources.open_log import open_log
from yawid.sources.read_options import Reading


def replay(
    log: Path,
    config: RunConfig,
    outputs: Outputs,
    stop: StopFlag,
    reading: Reading | None = None,
) -> tuple[dict[str, Any], Verdict]:
    """Replay one log; return its summary and verdict.

    Told to ``stop`` it keeps what it has read, by names and with a verdict that say so.

    Raises:
        Interrupted: told to stop before there was anything to keep.
        SourceError: the log cannot be read.
        SinkError: an output cannot be written.
        ConfigError: what is asked for does not fit the log.
    """
    digest = hashlib.sha256()
    reading = reading or Reading()
    pipeline = Pipeline(config, reading=reading)
    with stop.raising():
        pipeline.source = reader = open_log(log, pipeline.decoder, reading.form)
    pipeline.sinks = open_sinks(config, outputs)
    total, taken, is_whole = log.stat().st_size, 0, True
    with whole_or_none(pipeline.sinks):
        with progress(sys.stderr, log.name, total) as advance:
            for size, frames in reader.read(digest):
                if stop.is_set:
                    is_whole = False
                    break
                pipeline.take(frames)
                taken += size
                advance(size)
        if not is_whole and taken == 0:
            raise Interrupted(stop.exit_code)
        pipeline.finish()
        if is_whole:
            pipeline.channels.boots.check(config)
        if (warning := pipeline.channels.boots.warning(config)) is not None:
            sys.stderr.write(f"yawid: {warning}\n")
        if (said := reading.unchecked(pipeline.link)) is not None:
            sys.stderr.write(f"yawid: {said}\n")
        summary, verdict = summarise(pipeline, str(log.absolute()), digest.hexdigest())
        files = outputs.files()
        if not is_whole:
            summary, verdict = cut_short(summary, verdict, stop.name, (taken, total))
            files = keep_as_interrupted(pipeline.sinks, outputs)
        finish(pipeline, summary, files)
    return summary, verdict


def cut_short(
    summary: dict[str, Any], verdict: Verdict, signal: str, read_bytes: tuple[int, int]
) -> tuple[dict[str, Any], Verdict]:
    """Return summary and verdict of a run that a signal ended: a part of a log answers for no log.

    ``read_bytes`` are those read and those there are; there is no hash of the log.
    """
    read, total = read_bytes
    text = f"{signal} after {read / 1e6:.1f} of {total / 1e6:.1f} MB: what follows was not read"
    verdict = Verdict.of([Reason("interrupted", text), *verdict.reasons], verdict.method)
    told = {("bytes_read" if key == "sha256" else key): summary[key] for key in summary}
    return told | {"bytes_read": read, "verdict": as_summary(verdict)}, verdict
