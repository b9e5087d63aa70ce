"""Writing to a terminal that may hang (Ctrl-S, a slow ssh, a pager) without waiting for it."""

import contextlib
import io
import os
import queue
import threading
from typing import TextIO

MOST_WAITING = 1000
"""How many texts may wait for the terminal; further ones are left out."""
LEAVE_S = 1.0
"""How long the end of a session waits for texts that are not yet written."""


class Direct(io.TextIOBase):
    """A stream that writes to the file of ``stream`` unbuffered; a closed file is not an error.

    It holds no lock of the stream while it writes: a thread that waits for a terminal blocks no
    other thread and not the end of the process.
    """

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self._errors = stream.errors or "replace"
        self._file: int | None = None
        if os.name == "posix":
            with contextlib.suppress(OSError, ValueError):  # a StringIO has no file
                self._file = stream.fileno()

    @property
    def encoding(self) -> str:  # type: ignore[override] # in typeshed an attribute
        """The encoding in which text is written."""
        return self._stream.encoding or "utf-8"

    def isatty(self) -> bool:
        """Return whether the stream is a terminal."""
        return self._stream.isatty()

    def write(self, text: str) -> int:
        """Write the whole text, however long that takes; return its length."""
        try:
            if self._file is None:
                self._stream.write(text)
                self._stream.flush()
            else:
                data = text.encode(self.encoding, self._errors)
                while data:
                    data = data[os.write(self._file, data) :]
        except OSError:
            pass  # the terminal is closed; the session goes on
        return len(text)


class Outlet:
    """A thread that writes texts whole and in their order; only one caller at a time may use it."""

    def __init__(self, stream: TextIO) -> None:
        self._direct = Direct(stream)
        self._texts: queue.SimpleQueue[str | threading.Event] = queue.SimpleQueue()
        self._thread: threading.Thread | None = None

    def write(self, text: str) -> None:
        """Have a text written, unless ``MOST_WAITING`` wait already."""
        if self._texts.qsize() < MOST_WAITING:
            self._put(text)

    def drain(self) -> None:
        """Wait until all is written, at most ``LEAVE_S``; a later text starts a new thread."""
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
