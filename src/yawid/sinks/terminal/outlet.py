"""The way to a terminal that may hang (Ctrl-S, a slow ssh, a pager): it keeps nobody waiting."""

import contextlib
import io
import os
import queue
import threading
from typing import TextIO

MOST_WAITING = 1000
"""Texts that may wait for the terminal; what comes on top is left out."""
LEAVE_S = 1.0
"""How long an end waits for what has not been written."""


class Direct(io.TextIOBase):
    """Writes to the file behind ``stream`` and holds nothing back; one that has gone is no error.

    No lock of the stream is held meanwhile: who waits for a terminal holds up nobody else, not even
    the end of the process.
    """

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self._errors = stream.errors or "replace"
        self._file: int | None = None
        if os.name == "posix":
            with contextlib.suppress(OSError, ValueError):  # one of Python's own has no file
                self._file = stream.fileno()

    @property
    def encoding(self) -> str:  # type: ignore[override] # in typeshed an attribute
        """How text becomes bytes."""
        return self._stream.encoding or "utf-8"

    def isatty(self) -> bool:
        """Whether it is a terminal."""
        return self._stream.isatty()

    def write(self, text: str) -> int:
        """Write all of it, however long that takes."""
        try:
            if self._file is None:
                self._stream.write(text)
                self._stream.flush()
            else:
                data = text.encode(self.encoding, self._errors)
                while data:
                    data = data[os.write(self._file, data) :]
        except OSError:
            pass  # the terminal has gone: the session need not
        return len(text)


class Outlet:
    """Writes texts whole and in their order on a thread of its own; one caller at a time."""

    def __init__(self, stream: TextIO) -> None:
        self._direct = Direct(stream)
        self._texts: queue.SimpleQueue[str | threading.Event] = queue.SimpleQueue()
        self._thread: threading.Thread | None = None

    def write(self, text: str) -> None:
        """Have it written."""
        if self._texts.qsize() < MOST_WAITING:
            self._put(text)

    def drain(self) -> None:
        """End the thread once all is written, or wait no longer; what follows has another one."""
        if self._thread is not None:
            written = threading.Event()
            self._put(written)
            self._thread = None
            written.wait(LEAVE_S)

    def _put(self, item: str | threading.Event) -> None:
        self._texts.put(item)
        if self._thread is None:
            self._thread = threading.Thread(target=self._run, name="yawid-console", daemon=True)
            self._thread.start()

    def _run(self) -> None:
        while isinstance(item := self._texts.get(), str):
            self._direct.write(item)
        item.set()
