"""One replay, from the log to its finished files, and how a run is told to stop."""

from __future__ import annotations

import hashlib
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Any

from yawid.outputs import Outputs, finish, open_sinks, whole_or_none
from yawid.pipeline import Pipeline
from yawid.results.reasons import Verdict
from yawid.run_config import RunConfig
from yawid.sinks.progress import progress
from yawid.sources.logs import open_log
from yawid.sources.reading import Reading
from yawid.summary import summarise


class StopFlag:
    """Set by SIGINT or SIGTERM; a run then finishes its files and its summary as usual."""

    def __init__(self) -> None:
        self.is_set = False

    def _set(self, number: int, frame: FrameType | None) -> None:
        self.is_set = True

    @contextmanager
    def installed(self) -> Iterator[StopFlag]:
        """Catch the two signals while the context lasts."""
        numbers = (signal.SIGINT, signal.SIGTERM)
        before = [signal.signal(number, self._set) for number in numbers]
        try:
            yield self
        finally:
            for number, handler in zip(numbers, before, strict=True):
                signal.signal(number, handler)


def replay(
    log: Path,
    config: RunConfig,
    outputs: Outputs,
    stop: StopFlag,
    reading: Reading | None = None,
) -> tuple[dict[str, Any], Verdict]:
    """Replay one log; return its summary and verdict.

    Raises:
        SourceError: the log cannot be read.
        SinkError: an output cannot be written.
        ConfigError: what is asked for does not fit the log.
    """
    digest = hashlib.sha256()
    reading = reading or Reading()
    pipeline = Pipeline(config, reading=reading)
    reader = open_log(log, pipeline.decoder, reading.form)
    pipeline.source = reader
    pipeline.sinks = open_sinks(config, outputs)
    with whole_or_none(pipeline.sinks, outputs):
        with progress(sys.stderr, log.name, log.stat().st_size) as advance:
            for size, frames in reader.read(digest):
                pipeline.take(frames)
                advance(size)
                if stop.is_set:
                    break
        pipeline.finish()
        if (said := reading.unchecked(pipeline.link)) is not None:
            sys.stderr.write(f"yawid: {said}\n")
        summary, verdict = summarise(pipeline, str(log.absolute()), digest.hexdigest())
        finish(pipeline, summary, outputs.files())
    return summary, verdict
