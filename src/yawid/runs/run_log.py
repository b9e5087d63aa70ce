"""One recorded source through one pipeline: what replay, inspect, orders and regress have alike."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from yawid.blocks import SampleBlock
from yawid.channels.stage import WANTED
from yawid.config.run import BOTH, RunConfig
from yawid.errors import ConfigError
from yawid.pipeline import Pipeline
from yawid.runs.stop import StopFlag
from yawid.sources.open_log import Log, ReadOptions, Source


def open_log(log: Path, options: ReadOptions | None = None, *, again: bool = False) -> Log:
    """Open a log for the messages that the channels read; ``again``: it will be read repeatedly.

    Raises:
        SourceError: there is no such file, it cannot be read, or it is no log.
    """
    return Log(log, WANTED, options, again=again)


def settled(source: Log, config: RunConfig) -> RunConfig:
    """Return the configuration with what a record says of its rudder; a log's stays as it is.

    Raises:
        ConfigError: an option is missing, does not fit, or is for another kind of file.
        ChannelError: the record has no time, rudder or yaw rate.
        SourceError: a cell of it is not understood.
    """
    record = source.record
    if record is None:
        for name in ("columns", "units", "rudder_unit"):
            if getattr(config, name):
                option = name.replace("_", "-")
                raise ConfigError(f"--{option} is for CSV and Parquet, and {source.path} is a log")
        return config
    for name in BOTH:
        if getattr(config, name) != "auto":
            raise ConfigError(
                f"--{name} {getattr(config, name)}: {source.path} has columns, no channels; name "
                f"one by --columns {name}=COLUMN"
            )
    needs = [*config.inputs[1:]]
    needs += ["yaw"] if config.output == "yaw" else []
    needs += ["roll", "pitch", "q"] if config.output == "heading-rate" else []
    sign = config.rudder_sign if config.binds("rudder_sign") else None
    said = config.columns, config.units, config.rudder_unit, sign, config.rudder_max_deg
    from yawid.sources.records.find_columns import Asked  # a log needs nothing of it

    found = record.settle(Asked(*said, tuple(needs)))
    return replace(
        config,
        rudder_unit=found.rudder_unit,
        rudder_sign=found.rudder_sign,
        rudder_max_deg=found.rudder_max_deg,
        rudder_stroke_rad=found.stroke_rad,
    )


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
