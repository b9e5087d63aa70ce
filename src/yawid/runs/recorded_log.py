"""A log to be replayed: its messages say all, a record's columns are settled beforehand."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from yawid.answers.run_summary import RunSummary
from yawid.channels.stage import WANTED
from yawid.config.run import BOTH, RunConfig
from yawid.errors import ConfigError
from yawid.pipeline import Pipeline
from yawid.results.reasons import Verdict
from yawid.results.summary import summarise
from yawid.runs.outputs import parameters_of
from yawid.sources.open_log import Log, ReadOptions

if TYPE_CHECKING:
    from yawid.sinks.mcap.reader import LogLine


class RecordedLog(Log):
    """A log opened for the messages that the channels read.

    ``modes_of`` are autopilot and vehicle type, ``log_lines`` what a run said to people: both are
    known beforehand of a finished run alone.

    Raises:
        SourceError: there is no such file, it cannot be read, or it is no log.
    """

    modes_of = (0, 0)
    log_lines: "Sequence[LogLine]" = ()

    def __init__(
        self, path: Path, options: ReadOptions | None = None, *, again: bool = False
    ) -> None:
        super().__init__(path, WANTED, options, again=again)

    def settled(self, settings: Mapping[str, Any]) -> RunConfig:
        """Return the configuration, with what a record says of its rudder.

        Raises:
            ConfigError: an option is missing, does not fit, or is for another kind of file.
            ChannelError: the record has no time, rudder or yaw rate.
            SourceError: a cell of it is not understood.
        """
        config = RunConfig(**settings)
        if not self.format.has_columns:
            for name in ("columns", "units", "rudder_unit"):
                if getattr(config, name):
                    option = name.replace("_", "-")
                    raise ConfigError(
                        f"--{option} is for CSV and Parquet, and {self.path} is a log"
                    )
            return config
        for name in BOTH:
            if getattr(config, name) != "auto":
                raise ConfigError(
                    f"--{name} {getattr(config, name)}: {self.path} has columns, no channels; name "
                    f"one by --columns {name}=COLUMN"
                )
        needs = [*config.inputs[1:]]
        needs += ["yaw"] if config.output == "yaw" else []
        needs += ["roll", "pitch", "q"] if config.output == "heading-rate" else []
        sign = config.rudder_sign if config.binds("rudder_sign") else None
        said = config.columns, config.units, config.rudder_unit, sign, config.rudder_max_deg
        found = self.settle(*said, tuple(needs))
        return replace(
            config,
            rudder_unit=found.rudder_unit,
            rudder_sign=found.rudder_sign,
            rudder_max_deg=found.rudder_max_deg,
            rudder_stroke_rad=found.stroke_rad,
        )

    def rates_hz(self, rudder: str) -> None:
        """Return None: the messages themselves say it."""

    def left_open(self, pipeline: Pipeline) -> list[str]:
        """Return what a replay leaves open: boots passed over, signatures nobody looked at."""
        boots = pipeline.channels.boots.warning(pipeline.config)
        return [said for said in (boots, self.options.unchecked(self.link)) if said is not None]

    def parameters(self, pipeline: Pipeline) -> bytes:
        """Return the parameters that were seen."""
        return parameters_of(pipeline)

    def conclude(self, pipeline: Pipeline, *, is_whole: bool) -> tuple[RunSummary, Verdict]:
        """Return the summary and the verdict of what was read."""
        return summarise(pipeline, self.link, str(self.path.absolute()), self.sha256)
