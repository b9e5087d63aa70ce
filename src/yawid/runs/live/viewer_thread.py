"""A Rerun viewer next to a live session: it may be slow, go away and come back."""

from collections.abc import Callable, Mapping
from concurrent.futures import Executor, Future, wait

from yawid.answers.run_summary import RunSummary
from yawid.blocks import EstimateBlock, ModesBlock, SampleBlock
from yawid.runs.live.bulkhead import Bulkhead
from yawid.sinks.base import Call, Grid, Pace, Relay, Sink

WAITING = 512
"""How many calls of a session may wait for the viewer; further ones are skipped and counted."""
AGAIN_S = 10.0
"""How often a connection to a lost viewer is tried again."""
CLOSE_S = 5.0


class Viewer(Relay):
    """A sink that hands every call to the worker of all viewers: no session waits for a viewer.

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
        self._begin: Call | None = None
        self.working = Bulkhead("the viewer", "the session goes on without it", say)
        self._again = Pace(AGAIN_S)
        self._again.due()
        self._sink = connect(self._gone)

    @property
    def skipped(self) -> int:
        """The number of samples that no viewer has shown so far."""
        return self._not_taken + self._not_shown

    def start(self, grid: Grid) -> None:
        """See :meth:`yawid.sinks.base.Sink.start`; a viewer that comes later is given it too."""
        self._begin = lambda sink: sink.start(grid)
        self._hand(self._begin)

    def write(
        self, samples: SampleBlock, estimates: Mapping[str, EstimateBlock], modes: ModesBlock
    ) -> None:
        """See :meth:`yawid.sinks.base.Sink.write`."""

        def show(sink: Sink) -> None:
            sink.write(samples, estimates, modes)
            if self._lost:  # that showed during the call
                self._not_shown += len(samples)

        if self._lost or self.working.failure or not self._hand(show):
            self._not_taken += len(samples)

    def flush(self) -> None:
        """See :meth:`yawid.sinks.base.Sink.flush`."""
        if self._handed == self._done:
            super().flush()

    def finish(self, summary: RunSummary, attachments: Mapping[str, bytes]) -> None:
        """See :meth:`yawid.sinks.base.Sink.finish`; a viewer gets ``CLOSE_S`` for it, no more."""
        wait([self._submit(lambda sink: sink.finish(summary, attachments))], CLOSE_S)

    def _hand(self, call: Call) -> bool:
        has_room = self._handed - self._done < WAITING
        if has_room:
            self._submit(call)
        return has_room

    def _submit(self, call: Call) -> "Future[None]":
        self._handed += 1
        return self._worker.submit(self._run, call)

    def _run(self, call: Call) -> None:
        self.working.attempt(lambda: self._show(call), None)
        self._done += 1

    def _show(self, call: Call) -> None:
        if self._lost and self._again.due():
            self._seek()
        call(self._sink)

    def _seek(self) -> None:
        self._lost = False
        self._sink = self._connect(self._gone)
        if self._lost:
            return
        self._was_lost = False
        self._say("the Rerun viewer is back")
        if self._begin is not None:
            self._begin(self._sink)

    def _gone(self, text: str) -> None:
        """Note that the viewer is lost; the line about it is printed once until it is back."""
        self._lost = True
        if not self._was_lost:
            self._was_lost = True
            self._say(text)
