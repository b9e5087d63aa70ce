"""The lateral fits of a run: each follows its manoeuvre's answer as flown, and never delays it."""

import math
import time
from collections import deque
from collections.abc import Callable, Collection, Iterator, Sequence
from concurrent.futures import Executor, Future, wait
from typing import Any

from yawid.answers.reasons import Reason
from yawid.answers.run_summary import Bare, Flight, Manoeuvre
from yawid.blocks import SampleBlock
from yawid.lateral.gates import SURELY_APART
from yawid.lateral.motion import Motion
from yawid.lateral.motion_store import MotionStore
from yawid.manoeuvre.bare_answer import (
    Fitted,
    against_flown,
    bare_of,
    fitted,
    lateral_of,
    yaw_damped,
)
from yawid.manoeuvre.conditions import conditions
from yawid.quantities.vehicles import AIRFRAME

MOST_KEPT = 24
"""The most manoeuvres of a flight whose motion is kept for a fit over several of them: a bound of
memory, without which a flight of hours would have none."""


class Laterals:
    """The lateral motion of a run (``store``), and the airframe that each manoeuvre shows.

    With ``worker``, an executor of one thread, the fits are made there; the results are the same.
    ``modes_of`` are autopilot and vehicle type. ``yaw_loop`` gives the gains of the autopilot's yaw
    damper from one time to another, in s since boot. The fit takes its part in the rudder for the
    pilot's, so that a manoeuvre flown with one is refused from whenever its gains are known; one
    that only the sticks flew is not.
    """

    def __init__(
        self,
        longest_s: float,
        servo_lag_s: float | None,
        worker: Executor | None,
        modes_of: tuple[int, int],
        yaw_loop: Callable[[float, float], str | None],
    ) -> None:
        self._bares: dict[int, Bare] = {}
        self.store = MotionStore(longest_s)
        self._lag_s = servo_lag_s
        self._worker = worker
        self._modes_of, self._yaw_loop = modes_of, yaw_loop
        self._held_s: dict[int, tuple[float, float]] = {}
        """From when to when, in s since boot, the autopilot may have moved the rudder."""
        self._waiting: deque[tuple[int, Future[Fitted]]] = deque()
        self._found: list[Fitted] = []
        self._until_s = math.inf
        self.is_late = False

    def answer(self, n: int, samples: SampleBlock, flown: Future[Manoeuvre]) -> None:
        """Fit the airframe to the motion of manoeuvre ``n``, whose samples these are.

        Its answer as ``flown`` comes first: it may refuse the airframe without a fit.
        """
        motion = self.store.cut(samples)
        done, _ = conditions(samples, n, self._modes_of)
        if done.loop != AIRFRAME:
            self._held_s[n] = done.from_s, done.to_s
        gains = self._damper(n)
        future: Future[Fitted] = Future()
        if gains is not None:
            future.set_result(yaw_damped(n, gains))
        elif self._worker is not None:
            future = self._worker.submit(_airframe, n, motion, self._lag_s, flown)
        else:
            future.set_result(_airframe(n, motion, self._lag_s, flown))
        self._waiting.append((n, future))

    def ready(
        self, answered: Collection[int], *, until_s: float = -math.inf
    ) -> Iterator[tuple[int, Bare]]:
        """Yield number and airframe of each manoeuvre newly fitted, once.

        ``answered`` are the numbers of those answered as flown so far; a manoeuvre that is not
        waits for that. Those without a fit are waited for until ``until_s`` on the monotonic clock.
        """
        while self._waiting and done_by(self._waiting[0][1], until_s):
            if self._waiting[0][0] not in answered:
                return
            found = self._checked(self._waiting.popleft()[1].result())
            if len(self._found) < MOST_KEPT:
                self._found.append(found)
            self._bares[found.n] = lateral_of(found)
            yield found.n, self._bares[found.n]

    def leave_out(self, unanswered: Collection[int], until_s: float) -> list[str]:
        """Give up the fits that are not ready, and those of the manoeuvres without an answer.

        Return in words what is missing. No fit begins after ``until_s`` on the monotonic clock.
        """
        self._until_s = until_s
        given_up = [n for n, fit in self._waiting if n in unanswered or not fit.done()]
        self._waiting = deque(each for each in self._waiting if each[0] not in given_up)
        return [f"the bare airframe of manoeuvre {n}" for n in given_up if n not in unanswered]

    def bares(self) -> dict[int, Bare]:
        """Return the airframe of each manoeuvre fitted, by its number."""
        gains = {n: self._damper(n) for n in self._bares}
        refused = {n: lateral_of(yaw_damped(n, each)) for n, each in gains.items() if each}
        return self._bares | refused

    def changes(self) -> dict[int, list[Reason]]:
        """Return a warning of each manoeuvre within which the airframe changes, by its number."""
        text = "the airframe changes within it: two parts are {:.1f} sigma apart, and wn and zeta "
        text += "lie between them"
        return {
            each.n: [Reason("airframe_changes", text.format(each.airframe.failed["changes"]))]
            for each in self._found
            if each.airframe is not None and each.airframe.failed.get("changes", 0.0) > SURELY_APART
        }

    def flight(self, flown: Sequence[Flight]) -> Bare | None:
        """Return the airframe of all the manoeuvres fitted, None without any.

        ``flown`` are the flight's answers as flown. Where no manoeuvre shows the airframe by
        itself, that takes a fit, which is not begun once it ``is_late``.
        """
        found = [self._checked(each) for each in self._found]
        is_known = any(each.is_known for each in found)
        self.is_late = bool(found) and not is_known and time.monotonic() > self._until_s
        if self.is_late:
            return None
        alone = next((each for each in flown if each.loop == AIRFRAME and each), None)
        return bare_of(found, self._lag_s, alone)

    def _checked(self, found: Fitted) -> Fitted:
        """Return a fit, refused where a yaw damper has become known since it was asked for."""
        gains = self._damper(found.n)
        return found if gains is None else yaw_damped(found.n, gains)

    def _damper(self, n: int) -> str | None:
        return self._yaw_loop(*self._held_s[n]) if n in self._held_s else None


def _airframe(
    n: int, motion: Motion | str, servo_lag_s: float | None, flown: Future[Manoeuvre]
) -> Fitted:
    """Return the airframe of manoeuvre ``n``, once its answer as ``flown`` is there."""
    answer = flown.result()
    return against_flown(fitted(n, motion, servo_lag_s, answer), answer)


def done_by(future: Future[Any], until_s: float) -> bool:
    """Return whether a call is done; wait for it until ``until_s`` on the monotonic clock."""
    wait([future], max(until_s - time.monotonic(), 0.0))
    return future.done()
