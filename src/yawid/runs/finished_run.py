"""A finished run estimated again from the samples in its file, with other orders or memory.

Settings of the channels were fixed when the samples were made and cannot be changed here. Settings
of the estimators can, and the result is that of a replay of the log itself.
"""

import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from yawid.answers.heard import PARAMETERS
from yawid.answers.reasons import KINDS
from yawid.answers.run_summary import RunSummary
from yawid.blocks import MotionBlock, SampleBlock
from yawid.channels.segments import outside
from yawid.config.run import RunConfig
from yawid.config.settings import overruled
from yawid.errors import ConfigError, SourceError, YawidError
from yawid.pipeline import Pipeline
from yawid.quantities.link import LinkStats
from yawid.results.summary import judged, of_stream
from yawid.sinks.mcap.reader import DamagedError, McapRun, log_sha256_of, open_run, reading_of
from yawid.sources.formats import RUN
from yawid.system.stores import Place

CHANGEABLE = (
    "orders", "method", "also", "engine", "memory", "forgetting", "inputs", "from_s", "to_s",
    "manoeuvres", "lateral", "servo_lag", "ordinary", "given",
)  # fmt: skip


class FinishedRun:
    """A run's MCAP to be replayed, with the methods of :class:`yawid.runs.job.RecordedLog`.

    Of a file that was cut off it has the seconds before its first bad record.

    Raises:
        SourceError: the file cannot be read, has no sample or is not the file of a run.
    """

    format = RUN
    vehicle_id = None
    link = LinkStats()

    def __init__(self, path: Path) -> None:
        try:
            self._run = run = open_run(path)
        except DamagedError as error:
            from yawid.sinks.mcap.reader import open_torn  # seldom needed

            self._run = run = open_torn(path, error)
        self.path: Place = path  # or where the file was brought from
        self.size = path.stat().st_size
        self.log_lines = run.log
        grid = run.grid
        self.modes_of = (0, 0) if grid is None else (grid.autopilot, grid.vehicle_type)
        self.of_file = (run.summary.channels or {}).get("rudder"), run.summary.boots
        self._said: list[str] = []
        self._has_motion = False

    def settled(self, settings: Mapping[str, Any]) -> RunConfig:
        """Return the run's configuration, overruled by the settings.

        Raises:
            ConfigError: a setting asks for other samples than the file holds.
        """
        config = changed(self._run, settings)
        self._has_motion = config.keeps_motion and self._run.has_motion
        if self._run.has_motion:
            return config
        if config.asks_motion:
            self._said = [f"{self.path} holds no lateral motion: for that, replay the log itself"]
        return replace(config, ordinary=config.ordinary or "off", lateral=config.lateral or "off")

    def read(self) -> Iterator[tuple[int, SampleBlock | MotionBlock]]:
        """Yield (bytes, samples or motion); each sample counts for the same part of the size."""
        each, run = self.size / max(self._run.rows, 1), self._run
        for block in run.samples_and_motion() if self._has_motion else run.samples():
            yield (int(each * len(block)) if isinstance(block, SampleBlock) else 0), block

    def rates_hz(self, rudder: str) -> tuple[float, float] | None:
        """Return the rates of yaw and rudder messages in Hz, None where the run had no grid."""
        return self._run.rates_hz(rudder)

    def left_open(self, pipeline: Pipeline) -> list[str]:
        """Return warnings of what the file cannot give."""
        return self._said

    def parameters(self, pipeline: Pipeline) -> bytes:
        """Return the parameters that the file holds."""
        return self._run.attachments.get(PARAMETERS, b"")

    @property
    def reading(self) -> Mapping[str, str]:
        """How the run's log was read, where that was not the usual way."""
        return reading_of(self._run)

    def log_sha256(self) -> str | None:
        """Return the hash of the run's log, None where it was not read to its end."""
        return log_sha256_of(self._run)

    def conclude(self, pipeline: Pipeline, *, is_whole: bool) -> RunSummary:
        """Return the summary; reasons that come from the log stay as they were.

        Raises:
            ConfigError: no sample lies between --from and --to.
            SourceError: there is no sample, or a reason is unknown to this version.
        """
        run, bank, before = self._run, pipeline.bank, self._run.summary
        if is_whole and bank is None and run.grid is not None:
            raise _nothing(run, pipeline.config)
        said = before.deciding.reasons
        unknown = sorted({reason.id for reason in said} - KINDS.keys())
        if unknown and run.is_of_this_form:
            text = f"{run.path} holds reasons that this version does not know: {', '.join(unknown)}"
            raise SourceError(text)
        origins = ("run", "log") if run.grid is not None else ("run", "log", "samples")
        with run.path.open("rb") as stream:
            sha256 = hashlib.file_digest(stream, "sha256").hexdigest()
        summary = RunSummary(
            log=str(self.path.absolute()),
            sha256=sha256,
            source=before.source or before.own_source,
            duration_s=before.duration_s,
            vehicle=before.vehicle,
            link=before.link,
            channels=before.channels,
            estimates=None if bank is None else of_stream(bank),
            manoeuvres=pipeline.manoeuvres,
            bare=pipeline.bare(),
            ordinary=pipeline.ordinary(),
        )
        of_the_log = [reason for reason in said if reason.origin in origins]
        return judged(summary, pipeline, of_the_log, run.rates_hz(pipeline.config.inputs[0]))


def changed(run: McapRun, settings: Mapping[str, Any]) -> RunConfig:
    """Return the configuration of a run with other settings.

    Raises:
        ConfigError: a setting asks for other samples than the run's file holds.
    """
    before = asdict(run.config)
    for name, value in settings.items():
        same = value == before[name]
        if name == "rate" and run.grid is not None:
            same = abs(value * run.grid.sample_time_s - 1.0) < 1e-9
        if name not in CHANGEABLE and not same:
            option = name.replace("_", "-")
            raise ConfigError(
                f"{run.path} holds samples made with --{option} {before[name]}: "
                f"replay the log itself to have {value}"
            )
    config = RunConfig(**overruled(before, settings))
    if not set(config.inputs) <= set(run.config.inputs):
        raise ConfigError(
            f"{run.path} holds no {' and '.join(config.inputs)}: replay the log itself"
        )
    return config


def _nothing(run: McapRun, config: RunConfig) -> YawidError:
    """Return the error of a run that has no sample, or none between --from and --to."""
    if config.from_s is None and config.to_s is None:
        return SourceError(f"{run.path} holds no sample: replay the log itself")
    t_us = [block.boot_us[[0, -1]] for block in run.samples() if len(block)]
    covers = f"{np.min(t_us) / 1e6:.1f} to {np.max(t_us) / 1e6:.1f} s" if t_us else "nothing"
    return outside(config, f"{run.path}, which covers {covers}")
