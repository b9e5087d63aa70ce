"""The lateral fits of a run: each follows its manoeuvre's answer as flown, and never delays it."""

from collections import deque
from collections.abc import Iterator
from concurrent.futures import Executor, Future

from yawid.answers.run_summary import Bare
from yawid.blocks import MotionBlock, SampleBlock
from yawid.manoeuvres.bare_answer import Fitted, bare_of, fitted, lateral_of
from yawid.manoeuvres.motion_store import MotionStore

MOST_KEPT = 24
"""The most manoeuvres of a flight whose motion is kept for a fit over several of them."""


class Laterals:
    """The lateral motion of a run, and the airframe that each of its manoeuvres shows.

    With ``worker``, an executor of one thread, the fits are made there; the results are the same.
    """

    def __init__(
        self, longest_s: float, servo_lag_s: float | None, worker: Executor | None
    ) -> None:
        self.told: dict[int, Bare] = {}
        self._store = MotionStore(longest_s)
        self._lag_s = servo_lag_s
        self._worker = worker
        self._waiting: deque[tuple[tuple[int, int], Future[Fitted]]] = deque()
        self._found: list[Fitted] = []

    def feed(self, motion: MotionBlock) -> None:
        """Take motion in, before the samples of the same time."""
        self._store.feed(motion)

    def forget(self, samples: SampleBlock) -> None:
        """Forget what manoeuvres after these samples cannot need."""
        self._store.forget(samples)

    def answer(self, n: int, samples: SampleBlock) -> None:
        """Fit the airframe to the motion of manoeuvre ``n``, whose samples these are."""
        motion, span_ns = self._store.cut(samples), (samples.unix_ns[0], samples.unix_ns[-1])
        if self._worker is not None:
            future = self._worker.submit(fitted, n, motion, self._lag_s)
        else:
            future = Future()
            future.set_result(fitted(n, motion, self._lag_s))
        self._waiting.append(((int(span_ns[0]), int(span_ns[1])), future))

    def ready(self, *, wait: bool) -> Iterator[tuple[int, Bare, tuple[int, int]]]:
        """Yield number, airframe and Unix times of each manoeuvre newly fitted, once."""
        while self._waiting and (wait or self._waiting[0][1].done()):
            span_ns, future = self._waiting.popleft()
            found = future.result()
            if len(self._found) < MOST_KEPT:
                self._found.append(found)
            self.told[found.n] = lateral_of(found)
            yield found.n, self.told[found.n], span_ns

    def flight(self) -> Bare | None:
        """Return the airframe of all the manoeuvres fitted, None without any."""
        return bare_of(self._found, self._lag_s)
