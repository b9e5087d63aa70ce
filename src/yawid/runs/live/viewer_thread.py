"""A Rerun viewer next to a live session: it may be slow, go away and come back."""

from collections.abc import Callable
from concurrent.futures import Executor, Future, wait

from yawid.runs.live.bulkhead import Bulkhead
from yawid.sinks.base import Done, Event, Flush, Grid, Pace, RunRows, Sink

WAITING = 512
"""How many events of a session may wait for the viewer; further ones are skipped and counted."""
AGAIN_S = 10.0
"""How often a connection to a lost viewer is tried again."""
CLOSE_S = 5.0


class Viewer(Sink):
    """A sink that hands every event to the worker of all viewers: no session waits for a viewer.

    ``connect`` returns a new sink, and calls its argument with one line when the viewer is lost,
    at once or later. The first connection is made by the constructor itself, not by the worker. A
    lost viewer is tried again. ``skipped`` counts the samples that were not shown. ``working``
    guards the showing: any other failure ends it for good.
    """

    def __init__(
        self,
        connect: Callable[[Callable[[str], None]], Sink],
        say: Callable[[str], None],
        worker: Executor,
    ) -> None:
        # Of each pair the first is counted by the caller's thread, the second by the viewer's.
        self._not_taken = self._not_shown = 0
        self._handed = self._done = 0
        self._worker = worker
        self._connect = connect
        self._say = say
        self._lost = self._was_lost = False
        self._grid: Grid | None = None
        self.working = Bulkhead("the viewer", "the session goes on without it", say)
        self._again = Pace(AGAIN_S)
        self._again.due()
        self._sink = connect(self._gone)

    @property
    def skipped(self) -> int:
        """The number of samples that no viewer has shown so far."""
        return self._not_taken + self._not_shown

    def take(self, event: Event) -> None:
        """See :meth:`yawid.sinks.base.Sink.take`; a viewer that comes later is given the grid too.

        At the end a viewer gets ``CLOSE_S``, no more.
        """
        if isinstance(event, Done):
            wait([self._submit(event)], CLOSE_S)
            return
        if isinstance(event, Grid):
            self._grid = event
        waits = self._handed - self._done
        is_shown = not (self._lost or self.working.failure or waits >= WAITING)
        if isinstance(event, RunRows) and not is_shown:
            self._not_taken += len(event.samples)
        elif waits < WAITING and not (waits and isinstance(event, Flush)):
            self._submit(event)

    def _submit(self, event: Event) -> "Future[None]":
        self._handed += 1
        return self._worker.submit(self._run, event)

    def _run(self, event: Event) -> None:
        self.working.attempt(lambda: self._show(event), None)
        self._done += 1

    def _show(self, event: Event) -> None:
        if self._lost and self._again.due():
            self._seek()
        self._sink.take(event)
        if self._lost and isinstance(event, RunRows):  # that showed during the call
            self._not_shown += len(event.samples)

    def _seek(self) -> None:
        self._lost = False
        self._sink = self._connect(self._gone)
        if self._lost:
            return
        self._was_lost = False
        self._say("the Rerun viewer is back")
        if self._grid is not None:
            self._sink.take(self._grid)

    def _gone(self, text: str) -> None:
        """Note that the viewer is lost; the line about it is printed once until it is back."""
        self._lost = True
        if not self._was_lost:
            self._was_lost = True
            self._say(text)
