"""The answer as it stands while a session runs: what its summary would say if it ended now."""

import time
from concurrent.futures import Future
from typing import NamedTuple

from yawid.answers.run_summary import DutchRoll
from yawid.estimation.bank import Bank
from yawid.pipeline import Pipeline
from yawid.quantities.link import LinkStats
from yawid.results.reasons import Verdict
from yawid.results.summary import Basis, bank_summaries, basis_of, of_the_log
from yawid.runs.live.worker import Worker

AGAIN_S, SHARE = 2.0, 0.05
"""A stream is judged so far apart at least, and so that judging takes this part of the time."""
SHARE_SHOWN = 0.01
"""The same where a person looks on and nobody else hears of it."""


class Answer(NamedTuple):
    """A verdict and the Dutch roll that it is about, None where there is none."""

    verdict: Verdict
    dutch_roll: DutchRoll | None

    @property
    def state(self) -> str:
        """``usable``, or the first reason why it is not."""
        fatal = next((reason.id for reason in self.verdict.reasons if reason.exit_code), None)
        return "usable" if fatal is None else fatal


class RunningAnswer:
    """The answer of one session: the flight's where a manoeuvre was answered, else the stream's.

    A stream takes a tenth of a second to be judged: that is done beside the loop, by ``worker``, of
    the stream as it stood. Where the flight cannot be used yet its verdict stands and the stream
    still gives the numbers. ``share`` is the part of the time that judging the stream may take.
    """

    def __init__(self, worker: Worker, share: float = SHARE) -> None:
        self._worker = worker
        self._share = share
        self._judging: Future[tuple[Answer, float]] | None = None
        self._of_stream: Answer | None = None
        self._next_s = float("-inf")

    def look(self, pipeline: Pipeline, link: LinkStats) -> Answer | None:
        """Return the answer, None before there is one; made to be called about once a second."""
        basis = basis_of(pipeline, link)
        flight = pipeline.flight(of_the_log(basis.reasons))
        if flight is not None and flight[0].dutch_roll is not None:
            return Answer(flight[1], flight[0].dutch_roll)
        stream = self._stream(pipeline.bank, basis)
        if flight is not None:
            return Answer(flight[1], None if stream is None else stream.dutch_roll)
        return stream

    def _stream(self, bank: Bank | None, basis: Basis) -> Answer | None:
        """Return what was judged last, and have the stream judged again where it is time."""
        now_s = time.monotonic()
        if self._judging is not None and self._judging.done():
            self._of_stream, took_s = self._judging.result()
            self._judging, self._next_s = None, now_s + max(AGAIN_S, took_s / self._share)
        if bank is None or not bank.last or basis.rates_hz is None:
            return Answer(Verdict.of(basis.reasons), None)
        if self._judging is None and now_s >= self._next_s and not self._worker.waiting:
            self._judging = self._worker.submit(_judge, bank.snapshot(), basis)
        return self._of_stream


def _judge(bank: Bank, basis: Basis) -> tuple[Answer, float]:
    """Judge a stream; return how long it took, too."""
    begun_s = time.monotonic()
    summaries, evidence = bank_summaries(bank)
    verdict = basis.verdict(bank, evidence)
    summary = summaries.get(verdict.method or "")
    answer = Answer(verdict, None if summary is None else summary.dutch_roll)
    return answer, time.monotonic() - begun_s
