"""The whole stage: samples in; out come each manoeuvre's answer and, in the end, the flight's."""

import math
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Executor, Future
from functools import partial
from typing import Final

import numpy as np
from msgspec.structs import replace

from yawid.answers.reasons import Reason
from yawid.answers.run_summary import Bare, Flight, Manoeuvre
from yawid.blocks import EstimateBlock, Floats, Ints, SampleBlock
from yawid.manoeuvre.answered import answer
from yawid.manoeuvre.conditions import AirspeedCheck, is_bare
from yawid.manoeuvre.find import LONGEST_S, LONGEST_STATED_S, Finder
from yawid.manoeuvre.flight import flights_of
from yawid.manoeuvre.judge import ManoeuvreSetting
from yawid.manoeuvre.laterals import Laterals, done_by
from yawid.results.judge_samples import excitation_reasons

SAME: Final = 0.9
"""The part of a manoeuvre's yaw rates that another boot has, to the bit and at the same times, if
the log holds it twice. Two flights have none in common; of a log read twice only the first samples
of a boot differ. Without it a tlog that was appended to itself gave a sigma smaller by a tenth."""


LATEST_S: Final = 30.0
"""A manoeuvre is found at most so many s after its end, until when the estimates are kept."""


class Manoeuvres:
    """The manoeuvres of a run: found in the samples fed, and answered one after the other.

    With ``worker``, an executor of one thread, ``feed`` does not wait for the fits; without one
    they are made at once. In both cases the answers are the same and come in the order flown.
    ``waiting`` are those without an answer yet, by number; ``finder`` has the one under way.
    ``laterals`` fits the bare airframe on a worker of its own, None where it is not looked for;
    ``yaw_loop`` gives the gains of a yaw damper in a stretch, as far as they are known.
    """

    def __init__(
        self,
        setting: ManoeuvreSetting,
        worker: Executor | None = None,
        lateral_worker: Executor | None = None,
        yaw_loop: Callable[[float, float], str | None] = lambda from_s, to_s: None,
    ) -> None:
        self.answered: list[Manoeuvre] = []
        self.spans_ns: dict[int, tuple[int, int]] = {}
        """The Unix times of the first and the last sample of each manoeuvre, by its number."""
        self._setting = setting
        self._worker = worker
        self.waiting: deque[tuple[int, Future[Manoeuvre]]] = deque()
        self._count = self._repeated = 0
        self._flown: list[tuple[Ints, Floats]] = []
        self._running: deque[tuple[SampleBlock, Mapping[str, EstimateBlock]]] = deque()
        low_us, high_us = setting.config.window_us
        self.finder = Finder(
            setting.sample_time_s,
            setting.config.half_travel,
            partial(is_bare, setting.modes_of),
            is_stated=high_us - low_us <= 1e6 * LONGEST_STATED_S,
        )
        self._airspeed = AirspeedCheck(setting.sample_time_s)
        self.laterals: Laterals | None = None
        if setting.config.is_lateral:
            longest_s = LONGEST_STATED_S if self.finder.is_stated else LONGEST_S
            lag_s, modes_of = setting.config.servo_lag, setting.modes_of
            self.laterals = Laterals(longest_s, lag_s, lateral_worker, modes_of, yaw_loop)

    def feed(self, samples: SampleBlock, estimates: Mapping[str, EstimateBlock]) -> None:
        """Take samples in, and the recursive estimates of them by method."""
        self._running.append((samples, estimates))
        until_ns = samples.unix_ns[-1] - 1e9 * LATEST_S
        while len(self._running) > 1 and self._running[0][0].unix_ns[-1] < until_ns:
            self._running.popleft()
        self._airspeed.feed(samples)
        for found in self.finder.feed(samples):
            self._answer(found)
        if self.laterals is not None:
            self.laterals.store.forget(samples)

    def finish(self) -> None:
        """End the samples, and with them the manoeuvre that is under way."""
        for found in self.finder.finish():
            self._answer(found)

    def ready(self, *, until_s: float = -math.inf) -> Iterator[Manoeuvre]:
        """Yield each newly answered manoeuvre once; those without an answer are waited for.

        ``until_s`` is on the monotonic clock.
        """
        while self.waiting and done_by(self.waiting[0][1], until_s):
            answered = self.waiting.popleft()[1].result()
            self.answered.append(answered)
            yield answered

    def leave_out(self, until_s: float) -> list[str]:
        """Give up the answers that are not ready; return in words what is missing."""
        missing = [n for n, future in self.waiting if not future.done()]
        self.waiting = deque(each for each in self.waiting if each[1].done())
        bare = [] if self.laterals is None else self.laterals.leave_out(missing, until_s)
        return [*(f"the answer of manoeuvre {n}" for n in missing), *bare]

    def judged(self) -> list[Manoeuvre]:
        """Return those answered, warned of where the airframe changes within them."""
        changes = {} if self.laterals is None else self.laterals.changes()
        return [
            replace(each, verdict=each.verdict.with_reasons(changes.get(each.n, ())))
            for each in self.answered
        ]

    def flights(self, of_the_log: list[Reason]) -> list[Flight]:
        """Return the flight's answers from those answered: see :func:`flights_of`."""
        if self._repeated:
            text = (
                f"manoeuvres that the log holds again, with the same yaw rates at the same times "
                f"since boot: {self._repeated}; each counts once"
            )
            of_the_log = [*of_the_log, Reason("repeated", text)]
        return flights_of(self.judged(), of_the_log, self._airspeed.finding())

    def why_none(self, grounded: float) -> list[Reason]:
        """Return why there is no manoeuvre; ``grounded`` is the part of samples on the ground."""
        if self._count:
            text = "a manoeuvre has ended, and its answer was not ready in time"
            return [Reason("not_converged", text, "Replay the log, which waits for the answer.")]
        travel = self._setting.config.travel_said
        return [*excitation_reasons(self.finder.most_whole, self.finder.most_own, travel, grounded)]

    def bare(self) -> Bare | None:
        """Return the bare airframe of those answered; None where none was looked for."""
        if self.laterals is None:
            return None
        return self.laterals.flight(self.flights([]))

    def _stream_at(self, k: int) -> dict[str, EstimateBlock]:
        """Return the recursive estimates of the newest sample of this number, each a block of one.

        Its time would not do: a link that lags gives two samples the same one.
        """
        for samples, estimates in reversed(self._running):
            if len(at := np.flatnonzero(samples.k == k)):
                return {name: each.row(int(at[-1])) for name, each in estimates.items()}
        return {}

    def _is_repeated(self, found: SampleBlock) -> bool:
        """Return whether an earlier manoeuvre of the log has the same samples at the same times."""
        for boot_us, y in self._flown:
            _, own, other = np.intersect1d(found.boot_us, boot_us, True, return_indices=True)
            if np.count_nonzero(found.y[own] == y[other]) > SAME * len(found):
                return True
        self._flown.append((found.boot_us, found.y))
        return False

    def _answer(self, found: SampleBlock) -> None:
        if self._is_repeated(found):
            self._repeated += 1
            return
        self._count += 1
        self.spans_ns[self._count] = int(found.unix_ns[0]), int(found.unix_ns[-1])
        running = self._stream_at(int(found.k[-1]))
        if self._worker is not None:
            future = self._worker.submit(answer, found, self._count, self._setting, running)
        else:
            future = Future()
            future.set_result(answer(found, self._count, self._setting, running))
        self.waiting.append((self._count, future))
        if self.laterals is not None:
            self.laterals.answer(self._count, found, future)
