"""A run estimated once more from the samples its file holds: other orders, another memory.

What concerns the channels was decided when the samples were made and cannot be changed here; what
concerns the estimators can, and gives what a replay of the log itself would give.
"""

import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from yawid.blocks import SampleBlock
from yawid.channels.segments import outside
from yawid.config.run import RunConfig, overruled
from yawid.errors import ConfigError, SinkError, SourceError
from yawid.pipeline import Pipeline
from yawid.results.judge_estimate import Evidence, bank_verdict
from yawid.results.reasons import KINDS, Reason, Verdict
from yawid.results.run_summary import MethodSummary, RunSummary
from yawid.results.summary import as_summary, bank_summaries
from yawid.runs.choose_orders import with_orders
from yawid.runs.outputs import Outputs
from yawid.runs.replay import to_files
from yawid.runs.stop import StopFlag
from yawid.sinks.door import say
from yawid.sinks.mcap.reader import McapRun, open_run

CHANGEABLE = (
    "orders",
    "method",
    "also",
    "engine",
    "memory",
    "forgetting",
    "servo_tau",
    "inputs",
    "from_s",
    "to_s",
    "manoeuvres",
    "given",
)
NO_MANOEUVRES = "manoeuvres: replay the log"
JUDGED_AGAIN = frozenset(
    kind.id for kind in KINDS.values() if kind.origin in ("samples", "estimate")
)
"""Reasons that samples and estimates give; all others come from the log and stay as they were."""


def replay_run(
    mcap: Path,
    settings: Mapping[str, Any],
    outputs: Outputs,
    stop: StopFlag,
    *,
    automatic: bool = False,
) -> tuple[RunSummary, Verdict]:
    """Estimate a run's samples again; return the summary and the verdict.

    ``settings`` overrule those of the run; ``automatic`` chooses the orders by the samples.

    Raises:
        Interrupted: told to stop before there was anything to keep.
        SourceError: the file cannot be read, was not finished or is not a run's.
        ConfigError: a setting asks for other samples than the file holds.
        SinkError: an output cannot be written.
    """
    with stop.raising():
        run = open_run(mcap)
        written = [Path(path) for path in outputs.files().values()]
        if any(path.exists() and path.samefile(mcap) for path in written):
            raise SinkError(f"{mcap} would be overwritten by what is read from it: choose --out")
        config = changed(run, settings)
        if config.manoeuvres != "off" and not run.has_flight_state:
            say(f"{run.path} is of an older version; {NO_MANOEUVRES}")
            config = replace(config, manoeuvres="off")
        if automatic:
            config = with_orders(RunSource(run, config), config)
    source = RunSource(run, config)
    return to_files(source, mcap, config, outputs, stop, partial(conclude, run), run)


class RunSource:
    """The samples of a finished run that a configuration asks for, as a source."""

    def __init__(self, run: McapRun, config: RunConfig) -> None:
        self._run, self._config = run, config
        self.size = run.path.stat().st_size

    def read(self) -> Iterator[tuple[int, SampleBlock]]:
        """Yield (bytes, samples), a block for each epoch at least; samples lie evenly."""
        config, each = self._config, self.size / max(self._run.rows, 1)
        low, high = config.window_us
        columns = [self._run.config.inputs.index(name) for name in config.inputs]
        for block in self._run.samples():
            samples = replace(block, u=np.ascontiguousarray(block.u[:, columns]))
            rows = (samples.boot_us >= low) & (samples.boot_us <= high)
            samples = samples if rows.all() else samples.select(rows)
            for part in samples.epochs():
                yield int(each * len(part)), part


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


def _covered(run: McapRun) -> str:
    """Return what the samples of a run cover, in words."""
    t_us = [block.boot_us[[0, -1]] for block in run.samples() if len(block)]
    if not t_us:
        return "nothing"
    low, high = np.min(t_us) / 1e6, np.max(t_us) / 1e6
    return f"{low:.1f} to {high:.1f} s"


def conclude(run: McapRun, pipeline: Pipeline, is_whole: bool) -> tuple[RunSummary, Verdict]:
    """Return the summary and the verdict: what concerns the log stays as it was."""
    config, bank = pipeline.config, pipeline.bank
    if is_whole and bank is None and run.grid is not None:
        if config.from_s is None and config.to_s is None:
            raise SourceError(f"{run.path} holds no sample: replay the log itself")
        raise outside(config, f"{run.path}, which covers {_covered(run)}")
    with run.path.open("rb") as stream:
        sha256 = hashlib.file_digest(stream, "sha256").hexdigest()
    before = run.summary
    evidence: dict[str, Evidence] = {}
    estimates: dict[str, MethodSummary] | None = None
    said = before.verdict.reasons
    if unknown := sorted({r.id for r in said} - KINDS.keys()):
        raise SourceError(f"{run.path} gives reasons unknown to this version: {', '.join(unknown)}")
    reasons = [Reason(r.id, r.text) for r in said]
    of_the_log = [reason for reason in reasons if reason.id not in JUDGED_AGAIN]
    if bank is not None:
        estimates, evidence = bank_summaries(bank)
        rates_hz = run.rates_hz(config.inputs[0])
        assert rates_hz is not None  # there was a grid to make a bank for
        verdict = bank_verdict(bank, evidence, rates_hz, of_the_log)
    else:
        verdict = Verdict.of(reasons if run.grid is None else of_the_log)
    flight = pipeline.flight(of_the_log)
    summary = RunSummary(
        log=str(run.path.absolute()),
        sha256=sha256,
        source=before.source or before.own_source,
        duration_s=before.duration_s,
        vehicle=before.vehicle,
        link=before.link,
        channels=before.channels,
        estimates=estimates,
        verdict=as_summary(verdict),
        manoeuvres=pipeline.manoeuvres,
        flight=None if flight is None else flight[0],
    )
    return summary, verdict if flight is None else flight[1]
