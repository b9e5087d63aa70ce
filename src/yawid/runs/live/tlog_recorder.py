"""The session's tlog: what was heard, written as it is read."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from pathlib import Path

from yawid.errors import SinkError
from yawid.runs.live.guarded_sink import LOOK_S, check_present
from yawid.sinks.base import Pace, open_part, os_errors_as_sink_error, sync


class TlogRecorder:
    """Writes ``<path>.part`` and gives it the name ``path`` at the end; ``failure`` as in Guarded.

    What the system has been handed kill -9 cannot take back; a power cut can.

    Raises:
        SinkError: the file exists and ``force`` is not set, or it cannot be written.
    """

    def __init__(self, path: Path, tell: Callable[[str], None], *, force: bool) -> None:
        self.failure: str | None = None
        self._path = path
        self._tell = tell
        self._look = Pace(LOOK_S)
        self._part, self._stream = open_part(path, force=force)

    def write(self, data: bytes) -> None:
        """Add whole records and hand them to the system, before anything is made of them."""
        self._attempt(lambda: self._write(data))

    def look(self) -> None:
        """See that the file is still there, every ``LOOK_S``."""
        if self._look.due():
            self._attempt(lambda: check_present(self._part))

    def finish(self) -> Path | None:
        """Close and rename; return the file, None where there is none to be had."""
        self._attempt(self._finish)
        return None if self.failure else self._path

    def abort(self) -> None:
        """Close under the unfinished name: what was recorded stays."""
        with contextlib.suppress(OSError):  # what it could not write has been told already
            self._stream.close()

    def _write(self, data: bytes) -> None:
        self._stream.write(data)
        self._stream.flush()

    def _finish(self) -> None:
        sync(self._stream)
        self._stream.close()
        self._part.replace(self._path)

    def _attempt(self, act: Callable[[], object]) -> None:
        if self.failure is None:
            try:
                with os_errors_as_sink_error(self._part):
                    act()
            except SinkError as error:
                self.failure = str(error)
                self._tell(f"{error}: the session goes on without its tlog")
                self.abort()
