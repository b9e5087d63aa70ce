"""The Rerun sink, which decides what a failing or missing viewer or a full disk means for a run."""

import contextlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Final

from yawid.errors import SinkError, without_viewer
from yawid.sinks.base import Abort, Done, Event, Flush, Pace, Sink
from yawid.system.part_file import Part

if TYPE_CHECKING:
    from yawid.sinks.rerun.recording import RerunView

FLUSH_S: Final = 0.5  # the least wall time between two batches to a viewer


class RerunSink(Sink):
    """A sink that shows a run in Rerun; ``target`` is ``save``, ``spawn`` or a viewer's address.

    Of methods other than the primary one only the Dutch roll is drawn. ``path`` is the .rrd that
    ``save`` writes, named ``<path>.part`` until it is finished. A viewer that is missing or goes
    away causes one call of ``warn`` and nothing else; without ``warn`` it is needed.

    Raises:
        SinkError: the file exists and ``force`` is not set, it cannot be written, or there is no
        viewer where one is needed.
    """

    def __init__(
        self,
        target: str,
        *,
        name: str,
        warn: Callable[[str], None] | None,
        path: Path | None = None,
        force: bool = False,
    ) -> None:
        self._warn = warn
        self._pace = Pace(FLUSH_S)
        self._view: RerunView | None = None
        self.path = path if target == "save" else None
        # Rerun opens it again.
        self._file = None if self.path is None else Part(self.path, force=force)
        # Rerun's native part would also write to stderr the errors that it raises.
        os.environ.setdefault("RUST_LOG", "off")
        try:
            from yawid.sinks.rerun import recording  # half a second: only when needed

            self._view = recording.RerunView(self._file.place if self._file else target, name)
        except BaseException as error:  # also a signal
            if self._file is not None:
                self._file.remove()  # it is empty and would block the next run
            if not isinstance(error, Exception):
                raise
            self._failed(error)

    def take(self, event: Event) -> None:
        """See :meth:`yawid.sinks.base.Sink.take`; only a viewer is flushed, not a file."""
        if isinstance(event, Abort):
            with contextlib.suppress(SinkError):
                self._hand(event)
        elif not isinstance(event, Flush) or self._pace.due():
            self._hand(event)
        if isinstance(event, Abort | Done):
            self._view = None
            if self._file is None:
                return
            if isinstance(event, Abort):
                (self._file.remove if event.discard else self._file.leave)()
            elif self.path is not None:
                self._file.take_name(self.path)

    def _hand(self, event: Event) -> None:
        if self._view is None:
            return
        try:
            self._view.take(event)
        except Exception as error:
            self._failed(error)

    def _failed(self, error: Exception) -> None:
        """Go on without the viewer and warn.

        Raises:
            SinkError: a file was asked for, or the viewer is needed.
        """
        self._view = None
        needed = without_viewer(error)
        reason = needed or str(error).partition("\n")[0]
        if self._file is not None:
            raise SinkError(f"cannot write {self._file.place}: {reason}") from error
        if self._warn is None:
            advice = "write a recording with --out X.rrd and open it elsewhere"
            raise SinkError(needed or f"no Rerun viewer: {reason}; {advice}") from error
        self._warn(f"no Rerun viewer: {reason}; the run goes on without it")
