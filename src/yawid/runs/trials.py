"""Replays without outputs: what a log would answer with one configuration or another."""

from dataclasses import dataclass

import numpy as np

from yawid.answers.run_summary import MethodSummary, RunSummary
from yawid.config.run import BOTH, RunConfig
from yawid.results.judge_samples import reaction_shares
from yawid.results.reasons import Verdict
from yawid.runs.job import Recording, run
from yawid.sinks.terminal.progress import Bar


@dataclass(frozen=True, slots=True)
class Trial:
    """A replay without outputs: its configuration, what came of it, and the verdict that decides.

    ``aileron_reacts`` is the part of an aileron among the inputs that yaw rate and roll explain.
    """

    config: RunConfig
    summary: RunSummary
    verdict: Verdict
    aileron_reacts: float = 0.0

    @property
    def wn_rad_s(self) -> float:
        """The natural frequency of what answers, NaN where there is none."""
        roll = None if self.answer is None else self.answer.dutch_roll
        return np.nan if roll is None else roll.wn_rad_s

    @property
    def simulation_pct(self) -> float:
        """The free-running fit of what answers."""
        fit_pct = None if self.answer is None else self.answer.fit.simulation_pct
        return -np.inf if fit_pct is None else fit_pct

    @property
    def answer(self) -> MethodSummary | None:
        """The estimate that answers: a manoeuvre's, or the stream's where there is none."""
        manoeuvres, flight = self.summary.manoeuvres, self.summary.flight
        if not manoeuvres or flight is None:
            return (self.summary.estimates or {}).get(self.verdict.method or "")
        return next((m.answer for m in manoeuvres if m.n in flight.used), manoeuvres[0].answer)


class Trials:
    """Replays of one log without outputs, each configuration estimated once; ``bar`` shows each."""

    def __init__(self, source: Recording, bar: Bar) -> None:
        self._source = source
        self._bar = bar
        self._made: dict[RunConfig, Trial] = {}

    def of(self, config: RunConfig) -> Trial:
        """Return the trial of a configuration.

        Raises:
            ConfigError: the channels or the rate do not fit.
        """
        if config not in self._made:
            name, size = self._source.path.name, self._source.size
            self._bar.begin(f"{name}: trial {len(self._made) + 1}", size)
            job, reacts = run(self._source, config, advance=self._bar), 0.0
            if job.pipeline.bank is not None and config.inputs == BOTH:
                reacts = reaction_shares(job.pipeline.bank.history())[1]
            self._made[config] = Trial(config, *job.conclude(), reacts)
        return self._made[config]
