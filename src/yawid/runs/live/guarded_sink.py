"""A tlog or sink that fails is one line, and the session goes on without it."""

import contextlib
from collections.abc import Callable
from pathlib import Path

from yawid.errors import SinkError
from yawid.runs.live.bulkhead import Bulkhead
from yawid.sinks.base import Call, Pace, Relay, Sink
from yawid.sinks.part_file import open_part, os_errors_as_sink_error, sync, take_name

LOOK_S = 1.0


class Guard(Bulkhead):
    """What writes ``part`` and may fail, and is then closed; ``failure`` says why.

    A file that is removed while it is written raises no error by itself: that it is still there is
    looked at every ``LOOK_S``.
    """

    without = "it"
    """What the session goes on without."""

    def __init__(self, part: Path, tell: Callable[[str], None]) -> None:
        super().__init__(part.name, f"the session goes on without {self.without}", tell)
        self._part = part
        self._look = Pace(LOOK_S)

    def give_up(self, error: Exception) -> None:
        """Do without it from here on."""
        super().give_up(error)
        with contextlib.suppress(Exception):  # why it failed has been said
            self._close()

    def abort(self) -> None:
        """Close what is open, where it has not failed; its file keeps its unfinished name."""
        if self.failure is None:
            self._close()

    def _close(self) -> None:
        raise NotImplementedError

    def _check_present(self) -> None:
        if self._look.due() and not self._part.exists():
            raise SinkError(f"{self._part} has been removed")

    def _attempt(self, act: Callable[[], object]) -> None:
        """Do it, unless there was a failure before."""
        self.attempt(lambda: self._write_by(act), None)

    def _write_by(self, act: Callable[[], object]) -> None:
        with os_errors_as_sink_error(self._part):
            act()


class Guarded(Guard, Relay):
    """Stands in front of a sink that writes ``part``."""

    def __init__(self, sink: Sink, part: Path, tell: Callable[[str], None]) -> None:
        super().__init__(part, tell)
        self._sink = sink

    def flush(self) -> None:
        """See :class:`yawid.sinks.base.Sink`; looks, too, whether the file is still there."""
        self._attempt(self._flush)

    def _hand(self, call: Call) -> None:
        self._attempt(lambda: call(self._sink))

    def _close(self) -> None:
        self._sink.abort()

    def _flush(self) -> None:
        self._check_present()
        self._sink.flush()


class TlogRecorder(Guard):
    """Writes ``<path>.part`` and gives it the name ``path`` at the end.

    What the operating system has been handed kill -9 cannot take back; a power cut can.

    Raises:
        SinkError: the file exists and ``force`` is not set, or it cannot be written.
    """

    without = "its tlog"

    def __init__(self, path: Path, tell: Callable[[str], None], *, force: bool) -> None:
        part, self._stream = open_part(path, force=force)
        super().__init__(part, tell)
        self._path = path
        self._force = force

    def write(self, data: bytes) -> None:
        """Add whole records and hand them to the operating system, before they are estimated."""
        self._attempt(lambda: self._write(data))

    def look(self) -> None:
        """See that the file is still there, every ``LOOK_S``."""
        self._attempt(self._check_present)

    def finish(self) -> Path | None:
        """Close and rename; return the file, None where there is none to be had."""
        self._attempt(self._finish)
        return None if self.failure else self._path

    def _close(self) -> None:
        """Close under the unfinished name: what was recorded stays."""
        with contextlib.suppress(OSError):  # what it could not write has been said already
            self._stream.close()

    def _write(self, data: bytes) -> None:
        self._stream.write(data)
        self._stream.flush()

    def _finish(self) -> None:
        sync(self._stream)
        self._stream.close()
        take_name(self._part, self._path, force=self._force)
