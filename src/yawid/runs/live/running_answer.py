"""The answer while a session runs: the flight's, or until there is one the stream's number.

Status line, live screen and publisher all ask here, so that they say the same.
"""

import math
from typing import NamedTuple

import numpy as np

from yawid.answers.ordinary import OrdinaryAnswer
from yawid.answers.reasons import Verdict
from yawid.answers.run_summary import DutchRoll, Flight
from yawid.blocks import Status
from yawid.estimation.bank import Bank
from yawid.pipeline import Pipeline
from yawid.quantities.link import LinkStats
from yawid.results.excitation import CHUNK_S, excitation
from yawid.results.summary import dutch_roll_of_stream, log_reasons
from yawid.sinks.words import dutch_roll

NOT_JUDGED = "running, not judged"
KNOWN_WN = 0.1
"""P's sigma of wn, as a part of it, from which its number is not shown: of an AUTO mission, whose
rudder follows the aileron, it was 17 rad/s where 10 is true."""
SOUND = (Status.TRACKING, Status.HELD)
"""The statuses in which an estimator's number means something."""


class Answer(NamedTuple):
    """What is known of a session now.

    ``verdict`` is the flight's; before a manoeuvre is answered it says what the log lacks, and is
    None where it lacks nothing. ``flights`` are the flight's answers. ``running`` is the stream's
    Dutch roll until the flight has a usable answer, None while it is not known well enough.
    ``ordinary`` is that of ordinary flight of the last quarter of an hour.
    """

    verdict: Verdict | None
    flights: tuple[Flight, ...] = ()
    running: DutchRoll | None = None
    ordinary: OrdinaryAnswer | None = None

    @property
    def known(self) -> DutchRoll | None:
        """The flight's Dutch roll, None where the flight has no usable answer."""
        usable = self.verdict is not None and self.verdict.usable and bool(self.flights)
        return self.flights[0].dutch_roll if usable else None

    @property
    def state(self) -> str | None:
        """The word "usable", or the id of the first fatal reason; None without a verdict."""
        return None if self.verdict is None else self.verdict.why or "usable"


def said(answer: Answer) -> str:
    """Return wn and zeta in words, or that they are not known yet; and those of ordinary flight."""
    known = None if answer.running is None else dutch_roll(answer.running)
    text = "running: not known yet" if known is None else f"{NOT_JUDGED}: {known}"
    if answer.known is not None:
        text = dutch_roll(answer.known)
    if answer.ordinary is None or answer.ordinary.dutch_roll is None:
        return text
    after = f"after {answer.ordinary.seen_s / 60.0:.0f} min"
    return f"{text}; ordinary: {dutch_roll(answer.ordinary.dutch_roll)} {after}"


class RunningAnswer:
    """The answer of one session; it keeps when the rudder's own part last moved far enough."""

    def __init__(self) -> None:
        self._excited_at, self._looked_at = -math.inf, 0

    def look(self, pipeline: Pipeline, link: LinkStats) -> Answer:
        """Return the answer; to be called about once each second."""
        of_the_log = log_reasons(pipeline, pipeline.report(), link)
        flights = tuple(pipeline.flights(of_the_log))
        verdict = flights[0].verdict if flights else Verdict.of(of_the_log)
        is_known = bool(flights) and verdict.usable
        running = self._running(pipeline)
        said_of = None if not flights and verdict.usable else verdict
        return Answer(said_of, flights, None if is_known else running, pipeline.running)

    def _running(self, pipeline: Pipeline) -> DutchRoll | None:
        """Return the stream's Dutch roll while wn is known to 10 % by P's sigma.

        The rudder's own part must also have moved far enough within the estimator's memory: later P
        says little of what noise has made of theta since.
        """
        bank, method = pipeline.bank, pipeline.config.method
        if bank is None or not bank.last:
            return None
        self._move(bank, pipeline.samples)
        if int(bank.last[method].status[-1]) not in SOUND:
            return None
        forgotten = 1.0 - bank.config.forgetting_factor(bank.sample_time_s)
        if (pipeline.samples - self._excited_at) * forgotten > 1.0:
            return None
        roll = dutch_roll_of_stream(bank, method)
        if roll is None or roll.wn_std is None or roll.wn_std >= KNOWN_WN * roll.wn_rad_s:
            return None
        return roll

    def _move(self, bank: Bank, samples: int) -> None:
        """Look at the rudder of the samples since the last look, with those before for its mix."""
        new = samples - self._looked_at + round(CHUNK_S / bank.sample_time_s)
        seen = bank.history(new)
        own = excitation(
            seen.u[:, 0], seen.aileron, seen.mode, bank.config.half_travel, bank.sample_time_s
        )
        excited = np.flatnonzero(own.excited)
        if len(excited):
            self._excited_at = samples - len(own.own) + int(excited[-1])
        self._looked_at = samples
