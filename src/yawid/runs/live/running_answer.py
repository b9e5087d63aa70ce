"""The answer while a session runs: the one that its summary would have if it ended now.

Status line, live screen and publisher all ask here, so that they say the same.
"""

import time
from concurrent.futures import Future
from typing import NamedTuple

from yawid.answers.run_summary import DutchRoll, Flight
from yawid.estimation.bank import Bank
from yawid.pipeline import Pipeline
from yawid.quantities.link import LinkStats
from yawid.results.reasons import Verdict
from yawid.results.summary import Basis, bank_summaries, basis_of, of_the_log
from yawid.runs.live.worker import Worker
from yawid.sinks.words import dutch_roll

AGAIN_S, SHARE = 2.0, 0.05
"""The least time between two verdicts on a stream, and the part of the time they may take."""
SHARE_SHOWN = 0.01
"""The same part where the answer is only shown and not published."""


class Answer(NamedTuple):
    """A verdict, the Dutch roll it judges (None if there is none) and the answers of the flight."""

    verdict: Verdict
    dutch_roll: DutchRoll | None
    flights: tuple[Flight, ...] = ()

    @property
    def known(self) -> DutchRoll | None:
        """The numbers that are an answer: before it is usable, their sigma means nothing."""
        return self.dutch_roll if self.verdict.usable else None

    @property
    def state(self) -> str:
        """The word "usable", or the id of the first fatal reason."""
        fatal = next((reason.id for reason in self.verdict.reasons if reason.exit_code), None)
        return "usable" if fatal is None else fatal


def said(answer: Answer | None) -> str:
    """Return wn and zeta in words, or that they are not known yet."""
    known = None if answer is None else answer.known
    return "wn and zeta: not known yet" if known is None else dutch_roll(known)


class RunningAnswer:
    """The answer of one session: the flight's where a manoeuvre was answered, else the stream's.

    Judging a stream takes a tenth of a second: ``worker`` does it outside the loop, on a copy of
    the stream; without a worker no stream is judged. Where the flight has no Dutch roll yet, the
    verdict is the flight's and the numbers are the stream's. ``share`` is the part of the time that
    judging the stream may take.
    """

    def __init__(self, worker: Worker | None, share: float = SHARE) -> None:
        self._worker = worker
        self._share = share
        self._judging: Future[tuple[Answer, float]] | None = None
        self._of_stream: Answer | None = None
        self._next_s = float("-inf")

    def look(self, pipeline: Pipeline, link: LinkStats) -> Answer | None:
        """Return the answer, None before there is one; to be called about once each second."""
        basis = basis_of(pipeline, link)
        found = pipeline.flights(of_the_log(basis.reasons))
        flights = tuple(flight for flight, _ in found)
        if flights and flights[0].dutch_roll is not None:
            return Answer(found[0][1], flights[0].dutch_roll, flights)
        stream = self._stream(pipeline.bank, basis)
        if flights:
            roll = None if stream is None else stream.dutch_roll
            return Answer(found[0][1], roll, flights)
        return stream

    def _stream(self, bank: Bank | None, basis: Basis) -> Answer | None:
        """Return the last answer of the stream, and have the stream judged again when it is due."""
        now_s = time.monotonic()
        if self._judging is not None and self._judging.done():
            self._of_stream, took_s = self._judging.result()
            self._judging, self._next_s = None, now_s + max(AGAIN_S, took_s / self._share)
        if bank is None or not bank.last or basis.rates_hz is None:
            return Answer(Verdict.of(basis.reasons), None)
        if self._worker is None:
            return None
        if self._judging is None and now_s >= self._next_s and not self._worker.waiting:
            self._judging = self._worker.submit(_judge, bank.snapshot(), basis)
        return self._of_stream


def _judge(bank: Bank, basis: Basis) -> tuple[Answer, float]:
    """Judge a stream; return its answer, and the seconds that this took."""
    begun_s = time.monotonic()
    summaries, evidence = bank_summaries(bank)
    verdict = basis.verdict(bank, evidence)
    summary = summaries.get(verdict.method or "")
    answer = Answer(verdict, None if summary is None else summary.dutch_roll)
    return answer, time.monotonic() - begun_s
