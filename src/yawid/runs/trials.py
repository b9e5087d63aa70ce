"""Replays without outputs, to compare the answers of one log under several configurations."""

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
    """A replay without outputs: its configuration, its summary, and the deciding verdict.

    ``aileron_reacts`` is the part (0 to 1) of the aileron, where it is an input, that yaw rate and
    roll explain: such an aileron only reacts to the motion.
    """

    config: RunConfig
    summary: RunSummary
    verdict: Verdict
    aileron_reacts: float = 0.0

    @property
    def wn_rad_s(self) -> float:
        """The answer's natural frequency in rad/s, NaN where there is none."""
        roll = None if self.answer is None else self.answer.dutch_roll
        return np.nan if roll is None else roll.wn_rad_s

    @property
    def simulation_pct(self) -> float:
        """The answer's free-running fit in percent, -inf where there is none."""
        fit_pct = None if self.answer is None else self.answer.fit.simulation_pct
        return -np.inf if fit_pct is None else fit_pct

    @property
    def answer(self) -> MethodSummary | None:
        """The estimate that is the answer: a manoeuvre's, or the stream's without a flight."""
        manoeuvres, flight = self.summary.manoeuvres, self.summary.flight
        if not manoeuvres or flight is None:
            return (self.summary.estimates or {}).get(self.verdict.method or "")
        return next((m.answer for m in manoeuvres if m.n in flight.used), manoeuvres[0].answer)


class Trials:
    """Replays of one log without outputs, once for each configuration; ``bar`` shows progress."""

    def __init__(self, source: Recording, bar: Bar) -> None:
        self._source = source
        self._bar = bar
        self._made: dict[RunConfig, Trial] = {}

    def of(self, config: RunConfig) -> Trial:
        """Return the trial of a configuration.

        Raises:
            ConfigError: the channels or the rate asked for do not fit the log.
        """
        if config not in self._made:
            name, size = self._source.path.name, self._source.size
            self._bar.begin(f"{name}: trial {len(self._made) + 1}", size)
            job, reacts = run(self._source, config, advance=self._bar), 0.0
            if job.pipeline.bank is not None and config.inputs == BOTH:
                reacts = reaction_shares(job.pipeline.bank.history())[1]
            self._made[config] = Trial(config, *job.conclude(), reacts)
        return self._made[config]
