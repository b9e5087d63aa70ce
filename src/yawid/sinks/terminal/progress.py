"""Progress in the terminal: a bar while a log is read, a line for a live session."""

import os
import shutil
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, TextIO

from yawid.sinks.door import plain
from yawid.sinks.terminal.live_facts import LiveFacts
from yawid.sinks.terminal.outlet import Outlet
from yawid.sinks.terminal.restore import CLEAR_LINE, SHOW_CURSOR, SHOWN

if TYPE_CHECKING:
    from rich.progress import Progress, TaskID

SOON_S = 1.0
"""Work that takes no longer than this gets no bar."""
PLAIN_LINE_S = 10.0
TERMINAL_LINE_S = 0.5
_UNDO = CLEAR_LINE + SHOW_CURSOR
_TASK: "TaskID" = 0  # type: ignore[assignment] # the only task


class Bar:
    """A bar on ``stream`` that shows the progress of some work, after ``show`` was called."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self._lock = threading.Lock()
        self._name, self._total, self._done = "", 0.0, 0
        self._shown: Progress | None = None
        self._is_over = False

    def begin(self, name: str, total: float = 0.0) -> None:
        """Begin a piece of work: its name, and its size in any unit, 0 where that is unknown."""
        with self._lock:
            self._name, self._total, self._done = plain(name), total, 0
            if self._shown is not None:
                self._shown.reset(_TASK, description=self._name, total=total or None)

    def __call__(self, count: int) -> None:
        """Add ``count`` to the work that is done."""
        self._done += count
        if self._shown is not None:
            self._shown.update(_TASK, completed=self._done)

    def show(self) -> None:
        """Show the bar from now on."""
        from rich import progress as parts
        from rich.console import Console as RichConsole

        columns = (
            parts.TextColumn("{task.description}", markup=False),
            parts.BarColumn(),
            parts.TaskProgressColumn(show_speed=False),
            parts.TimeElapsedColumn(),
        )
        with self._lock:
            if not self._is_over:
                console = RichConsole(file=self._stream, markup=False)
                self._shown = parts.Progress(*columns, console=console, transient=True)
                self._shown.add_task(self._name, total=self._total or None, completed=self._done)
                SHOWN.append(_UNDO)  # first: a signal may come at once
                self._shown.start()

    def close(self) -> None:
        """Remove the bar."""
        with self._lock:
            self._is_over = True
            if self._shown is not None:
                self._shown.stop()
                SHOWN.remove(_UNDO)


@contextmanager
def progress(stream: TextIO, name: str, total: float = 0.0) -> Iterator[Bar]:
    """Show on a terminal the progress of work that takes longer than ``SOON_S``.

    Yields a bar, which is called with each further part of ``total`` (0: unknown) that is done.
    """
    bar = Bar(stream)
    bar.begin(name, total)
    if not updates_in_place(stream):
        yield bar
        return
    soon = threading.Timer(SOON_S, bar.show)
    soon.daemon = True
    soon.start()
    try:
        yield bar
    finally:
        soon.cancel()
        bar.close()


class Console:
    """A writer of lines to ``stream``; on a terminal, one line is updated in place.

    ``period_s`` is the time between two updates; its default depends on the kind of the stream.
    Any thread may use it: lines are written whole, and no caller waits for a terminal that hangs.
    """

    draws = False
    """Whether the console takes facts and draws a screen; else it takes a line."""
    share = 0.3
    """The part of a session's time that gathering its state may take."""
    failure: Exception | None = None
    """The error after which nothing is drawn any more; lines are still written."""

    def __init__(self, stream: TextIO, period_s: float | None = None) -> None:
        self._is_terminal = updates_in_place(stream)
        usual_s = TERMINAL_LINE_S if self._is_terminal else PLAIN_LINE_S
        self._period_s = usual_s if period_s is None else period_s
        self._next_s = time.monotonic() + self._period_s
        self._shown = ""
        self._lock = threading.Lock()
        self._outlet = Outlet(stream)

    def say(self, text: str) -> None:
        """Write a line that is not updated later."""
        with self._lock:
            clear = CLEAR_LINE if self._shown else ""
            self._outlet.write(f"{clear}yawid: {plain(text)}\n{self._shown}")

    def is_due(self) -> bool:
        """Return whether the next update of the line is due."""
        return time.monotonic() >= self._next_s

    def draw(self, facts: LiveFacts, took_s: float) -> bool:
        """Draw the facts, which took ``took_s`` to gather; return True; only where it ``draws``."""
        raise NotImplementedError

    def show(self, line: str, took_s: float = 0.0) -> None:
        """Show the session's state: in place on a terminal, else as a line of its own.

        The longer it took to gather, the later the next one is due.
        """
        self._rest(took_s)
        line = plain(line)
        with self._lock:
            if self._is_terminal:
                self._shown = line[: shutil.get_terminal_size().columns - 1]
                self._outlet.write(CLEAR_LINE + self._shown)
            else:
                self._outlet.write(f"yawid: {line}\n")

    def _rest(self, took_s: float) -> None:
        self._next_s = time.monotonic() + max(self._period_s, took_s / self.share)

    def close(self) -> None:
        """End the line that is updated, and wait for what is not yet written, see ``Outlet``."""
        with self._lock:
            if self._shown:
                self._shown = ""
                self._outlet.write("\n")
            self._outlet.drain()


def updates_in_place(stream: TextIO) -> bool:
    """Return whether the stream is a terminal on which a line can be overwritten."""
    return stream.isatty() and os.environ.get("TERM") not in ("dumb", "unknown")
