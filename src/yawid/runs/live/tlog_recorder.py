"""The session's tlog: what was received, written as it is read."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from pathlib import Path

from yawid.runs.live.guarded_sink import Guard
from yawid.sinks.part_file import open_part, sync


class TlogRecorder(Guard):
    """Writes ``<path>.part`` and gives it the name ``path`` at the end.

    What the operating system has been handed kill -9 cannot take back; a power cut can.

    Raises:
        SinkError: the file exists and ``force`` is not set, or it cannot be written.
    """

    what = "its tlog"

    def __init__(self, path: Path, tell: Callable[[str], None], *, force: bool) -> None:
        part, self._stream = open_part(path, force=force)
        super().__init__(part, tell)
        self._path = path

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

    def abort(self) -> None:
        """Close under the unfinished name: what was recorded stays."""
        with contextlib.suppress(OSError):  # what it could not write has been said already
            self._stream.close()

    def _write(self, data: bytes) -> None:
        self._stream.write(data)
        self._stream.flush()

    def _finish(self) -> None:
        sync(self._stream)
        self._stream.close()
        self._part.replace(self._path)
