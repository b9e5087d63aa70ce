"""Guards of the tlog and the sinks: one that fails is reported, and the session goes on."""

import contextlib
from collections.abc import Callable
from pathlib import Path

from yawid.errors import SinkError
from yawid.runs.live.bulkhead import Bulkhead
from yawid.sinks.base import Abort, Event, Flush, Pace, Sink
from yawid.system.part_file import Part, os_errors_as_sink_error, sync

LOOK_S = 1.0


class Guard(Bulkhead):
    """A guard of a writer of the file ``part``, which is closed after a failure.

    Writing to a file that has been removed raises no error: therefore the guard checks every
    ``LOOK_S`` that the file still exists.
    """

    without = "it"
    """The name of what the session goes on without, in a message."""

    def __init__(self, part: Path, say: Callable[[str], None]) -> None:
        super().__init__(part.name, f"the session goes on without {self.without}", say)
        self._part = part
        self._look = Pace(LOOK_S)

    def give_up(self, error: Exception) -> None:
        """Report the error and close: nothing more is written."""
        super().give_up(error)
        with contextlib.suppress(Exception):  # the cause has been reported
            self._close()

    def abort(self) -> None:
        """Close, unless a failure has closed it already; the file keeps its unfinished name."""
        if self.failure is None:
            self._close()

    def _close(self) -> None:
        raise NotImplementedError

    def look(self) -> None:
        """Check every ``LOOK_S`` that the file still exists."""
        self._attempt(self._check_present)

    def _check_present(self) -> None:
        if self._look.due() and not self._part.exists():
            raise SinkError(f"{self._part} has been removed")

    def _attempt(self, act: Callable[[], object]) -> None:
        """Call ``act``, unless there was a failure before."""
        self.attempt(os_errors_as_sink_error(self._part)(act), None)


class Guarded(Guard, Sink):
    """A sink that hands every event to another sink, which writes ``part``, and guards it."""

    def __init__(self, sink: Sink, part: Path, say: Callable[[str], None]) -> None:
        super().__init__(part, say)
        self._sink = sink

    def take(self, event: Event) -> None:
        """See :class:`yawid.sinks.base.Sink`; a flush also checks that the file is still there."""
        if isinstance(event, Abort):
            self.abort()
            return
        if isinstance(event, Flush):
            self.look()
        self._attempt(lambda: self._sink.take(event))

    def _close(self) -> None:
        self._sink.take(Abort())


class TlogRecorder(Guard):
    """The recorder of a tlog: it writes ``<path>.part``, which is renamed ``path`` at the end.

    Data handed to the operating system survive kill -9, but not a power cut.

    Raises:
        SinkError: the file exists and ``force`` is not set, or it cannot be written.
    """

    without = "its tlog"

    def __init__(self, path: Path, say: Callable[[str], None], *, force: bool) -> None:
        self._file = Part(path, force=force)
        self._stream = self._file.stream
        super().__init__(self._file.place, say)
        self._path = path

    def write(self, data: bytes) -> None:
        """Add whole records and hand them to the operating system at once."""
        self._attempt(lambda: self._write(data))

    def finish(self) -> Path | None:
        """Close and rename the file; return its path, None where the recorder has failed."""
        self._attempt(self._finish)
        return None if self.failure else self._path

    def _close(self) -> None:
        """Close the file under its unfinished name: it keeps what was recorded."""
        self._file.leave()

    def _write(self, data: bytes) -> None:
        self._stream.write(data)
        self._stream.flush()

    def _finish(self) -> None:
        sync(self._stream)
        self._file.take_name(self._path)
