"""The Rerun sink: what a failing viewer, a missing one or a full disk means for the run."""

import contextlib
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Final

from yawid.blocks import EstimateBlock, ModesBlock, SampleBlock
from yawid.errors import SinkError
from yawid.results.run_summary import Manoeuvre, RunSummary
from yawid.sinks.base import Grid, LogLevel, Pace
from yawid.sinks.part_file import open_part, take_name

if TYPE_CHECKING:
    from yawid.sinks.rerun.recording import RerunView

FLUSH_S: Final = 0.5  # of wall time between two batches to a viewer


class RerunSink:
    """Shows a run in Rerun; ``target`` is ``save``, ``spawn`` or the address of a viewer.

    ``path`` is the .rrd of ``save``: ``<path>.part`` until finished, and may be changed until then.
    A viewer that cannot be had or goes away costs one call of ``warn`` and nothing else, unless it
    is ``needed``.

    Raises:
        SinkError: the file exists and ``force`` is not set, it cannot be written, or there is no
        viewer where one is needed.
    """

    def __init__(
        self,
        target: str,
        *,
        name: str,
        warn: Callable[[str], None],
        path: Path | None = None,
        force: bool = False,
        needed: bool = False,
    ) -> None:
        self._warn = warn
        self._needed = needed
        self._pace = Pace(FLUSH_S)
        self._view: RerunView | None = None
        self._force = force
        self.path = path if target == "save" else None
        self._part: Path | None = None
        if target == "save":
            if path is None:
                raise SinkError("a recording to be saved needs a file name")
            self._part, stream = open_part(path, force=force)
            stream.close()  # it is there and can be written; rerun opens it again
        try:
            self._view = _open_view(self._part or target, name)
        except BaseException as error:  # a signal too
            self.discard()  # nothing in it, and it would stand in the way
            if not isinstance(error, Exception):
                raise
            self._failed(error)

    def start(self, grid: Grid) -> None:
        """See the protocol; of methods after the first only the Dutch roll is drawn."""
        self._attempt(lambda view: view.start(grid))

    def write(
        self, samples: SampleBlock, estimates: Mapping[str, EstimateBlock], modes: ModesBlock
    ) -> None:
        """See :meth:`yawid.sinks.base.Sink.write`."""
        self._attempt(lambda view: view.write(samples, estimates, modes))

    def manoeuvre(self, found: Manoeuvre, span_ns: tuple[int, int]) -> None:
        """See :meth:`yawid.sinks.base.Sink.manoeuvre`."""
        self._attempt(lambda view: view.manoeuvre(found, span_ns))

    def log(self, unix_ns: int, level: LogLevel, text: str) -> None:
        """See :meth:`yawid.sinks.base.Sink.log`."""
        self._attempt(lambda view: view.log(unix_ns, level, text))

    def flush(self) -> None:
        """See :meth:`yawid.sinks.base.Sink.flush`; only a viewer is flushed, not a file."""
        if self._pace.due():
            self._attempt(lambda view: view.flush())

    def finish(self, summary: RunSummary, attachments: Mapping[str, bytes]) -> None:
        """See :meth:`yawid.sinks.base.Sink.finish`; attachments are for files that keep them."""
        self._attempt(lambda view: view.finish(summary))
        self._view = None
        if self._part is not None and self.path is not None:
            take_name(self._part, self.path, force=self._force)

    def abort(self) -> None:
        """See :meth:`yawid.sinks.base.Sink.abort`."""
        with contextlib.suppress(SinkError):
            self._attempt(lambda view: view.close())
        self._view = None

    def discard(self) -> None:
        """Abort and remove what was written; it is this sink's own, nobody else may."""
        self.abort()
        if self._part is not None:
            with contextlib.suppress(OSError):
                self._part.unlink(missing_ok=True)

    def _attempt(self, act: "Callable[[RerunView], None]") -> None:
        if self._view is None:
            return
        try:
            act(self._view)
        except Exception as error:
            self._failed(error)

    def _failed(self, error: Exception) -> None:
        """Do without the viewer from here on; a file that was asked for is another matter."""
        self._view = None
        reason = str(error).partition("\n")[0]
        if self._part is not None:
            raise SinkError(f"cannot write {self._part}: {reason}") from error
        if self._needed:
            advice = "--save X.rrd writes a recording to open elsewhere"
            raise SinkError(f"no Rerun viewer: {reason}; {advice}") from error
        self._warn(f"no Rerun viewer: {reason}; the run goes on without it")


def _open_view(target: str | Path, name: str) -> "RerunView":
    # Rerun's native part would write its own lines to stderr for what it also raises.
    os.environ.setdefault("RUST_LOG", "off")
    from yawid.sinks.rerun.recording import RerunView  # half a second: only for those who want it

    return RerunView(target, name)
