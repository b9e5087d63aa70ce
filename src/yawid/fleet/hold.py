"""The lock of a data set in a store: an object that a fleet puts there and removes at its end."""

import os
import platform
import uuid
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from yawid.errors import SinkError
from yawid.sinks.door import say
from yawid.system.part_file import os_errors_as_sink_error
from yawid.system.stores import StoredPath

COPY: Final = "held"
"""File in the folder ``here`` with the content of this machine's newest lock."""


class Hold:
    """The lock ``place``, created by a write that only one of several writers can do.

    ``here`` is locked for this process. Where its copy shows that the lock is of an earlier process
    of this machine, that one was killed, and its lock is replaced.

    Raises:
        SinkError: another machine has the lock, or the store cannot be written.
    """

    def __init__(self, place: StoredPath, here: Path) -> None:
        self._place, self._copy = place, here / COPY
        since = datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC")
        who = f"{platform.node()}, process {os.getpid()}, since {since}"
        with os_errors_as_sink_error(place):
            if self._copy.exists() and self._content() == self._copy.read_bytes():
                place.unlink(missing_ok=True)
            self._own = f"{who}, {uuid.uuid4().hex}".encode()
            self._copy.write_bytes(self._own)
            if not place.create(self._own):
                held = (self._content() or b"").decode("utf-8", "replace").rpartition(",")[0]
                raise SinkError(
                    f"another yawid fleet is writing there ({held}): wait until it has ended; if "
                    f"it was killed, delete {place}"
                )
            if not place.creates_once:
                say(f"{place}: this store cannot refuse a second writer: run one fleet at a time")

    def check(self) -> None:
        """Check that the lock is still this one.

        Raises:
            SinkError: another fleet has taken it, or the store cannot be read.
        """
        with os_errors_as_sink_error(self._place):
            if self._content() != self._own:
                raise SinkError(
                    f"{self._place} was removed or replaced: another fleet may be writing; repeat "
                    "the command, finished logs are kept"
                )

    def release(self) -> None:
        """Remove the lock if it is still this one."""
        with suppress(OSError):
            if self._content() == self._own:
                self._place.unlink(missing_ok=True)

    def _content(self) -> bytes | None:
        try:
            return self._place.read_bytes()
        except FileNotFoundError:
            return None
