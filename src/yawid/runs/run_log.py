"""One recorded source through one pipeline: what replay, inspect, orders and regress have alike."""

from collections.abc import Callable
from pathlib import Path

from yawid.blocks import SampleBlock
from yawid.channels.stage import WANTED
from yawid.config.run import RunConfig
from yawid.pipeline import Pipeline
from yawid.runs.stop import StopFlag
from yawid.sources.open_log import Log, ReadOptions, Source


def open_log(log: Path, options: ReadOptions | None = None, *, again: bool = False) -> Log:
    """Open a log for the messages that the channels read; ``again``: it will be read repeatedly.

    Raises:
        SourceError: there is no such file, it cannot be read, or it is no log.
    """
    return Log(log, WANTED, options, again=again)


def run_log(
    source: Source,
    pipeline: Pipeline,
    stop: StopFlag | None = None,
    advance: Callable[[int], None] = lambda size: None,
) -> tuple[int, bool]:
    """Run a source through a pipeline, whose sinks stay open; return the bytes read, and if all.

    Told to ``stop``, it ends before the next piece; ``advance`` is called with the size of each.

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


class KeepingPipeline(Pipeline):
    """A pipeline without sinks that keeps its samples, for what looks at a record as a whole."""

    def __init__(self, config: RunConfig) -> None:
        super().__init__(config)
        self.kept: list[SampleBlock] = []

    def estimate(self, samples: SampleBlock) -> None:
        """See :class:`Pipeline`."""
        self.kept.append(samples)
        super().estimate(samples)
