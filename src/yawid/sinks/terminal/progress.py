"""Progress in the terminal: a bar while a log is read, and what a killed process must undo.

A screen or a bar registers the codes that leave the terminal as it was (the hidden cursor, the
other screen, a bar). A signal handler writes them before the process is killed (a second Ctrl-C).
"""

import contextlib
import os
import select
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final, TextIO

from yawid.sinks.door import plain

SHOW_CURSOR: Final = "\x1b[?25h"
OWN_SCREEN: Final = "\x1b[?1049l" + SHOW_CURSOR
CLEAR_LINE: Final = "\r\x1b[2K"

SHOWN: Final[list[str]] = []
"""The codes that undo what is on the terminal, stderr, now."""


def leave() -> None:
    """Leave the terminal whole if it takes text now; else, and if it is closed, do nothing."""
    with contextlib.suppress(OSError, ValueError):
        if os.name != "posix" or select.select([], [sys.stderr.fileno()], [], 0.0)[1]:
            os.write(sys.stderr.fileno(), "".join(SHOWN).encode("ascii"))


SOON_S = 1.0
"""Work that takes no longer than this gets no bar."""
REFRESH_S: Final = 0.05
_UNDO = CLEAR_LINE + SHOW_CURSOR


class Bar:
    """A bar that shows the progress of some work: a thread draws it, ``SOON_S`` after its begin."""

    def __init__(self, name: str, total: float) -> None:
        self.is_over = threading.Event()
        self.begin(name, total)

    def begin(self, name: str, total: float = 0.0) -> None:
        """Begin a piece of work: its name, and its size in any unit, 0 where that is unknown."""
        self._name, self._total, self._done = plain(name), total, 0

    def __call__(self, count: int) -> None:
        """Add ``count`` to the work that is done."""
        self._done += count

    def draw(self, stream: TextIO) -> None:
        """Draw the bar until the work is over."""
        if self.is_over.wait(SOON_S):
            return
        from rich import progress as parts
        from rich.console import Console as RichConsole

        columns = (
            parts.TextColumn("{task.description}", markup=False),
            parts.BarColumn(),
            parts.TaskProgressColumn(show_speed=False),
            parts.TimeElapsedColumn(),
        )
        console = RichConsole(file=stream, markup=False)
        shown = parts.Progress(*columns, console=console, transient=True)
        task = shown.add_task(self._name, total=self._total or None, completed=self._done)
        SHOWN.append(_UNDO)  # first: a signal may come at once
        with shown:
            while not self.is_over.wait(REFRESH_S):
                shown.update(
                    task, description=self._name, total=self._total or None, completed=self._done
                )
        SHOWN.remove(_UNDO)


@contextmanager
def progress(stream: TextIO, name: str, total: float = 0.0) -> Iterator[Bar]:
    """Show on a terminal the progress of work that takes longer than ``SOON_S``.

    Yields a bar, which is called with each further part of ``total`` (0: unknown) that is done.
    """
    bar = Bar(name, total)
    thread = threading.Thread(target=bar.draw, args=(stream,), daemon=True)
    if updates_in_place(stream):
        thread.start()
    try:
        yield bar
    finally:
        bar.is_over.set()
        if thread.is_alive():
            thread.join()


def updates_in_place(stream: TextIO) -> bool:
    """Return whether the stream is a terminal on which a line can be overwritten."""
    return stream.isatty() and os.environ.get("TERM") not in ("dumb", "unknown")
