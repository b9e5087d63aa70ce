"""What a person sees while it runs: a bar for a log that is read, a line for a live session."""

import os
import shutil
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TextIO

from yawid.sinks.terminal.live_facts import LiveFacts
from yawid.sinks.terminal.outlet import Outlet

PLAIN_LINE_S = 10.0
TERMINAL_LINE_S = 0.5
_CLEAR = "\r\x1b[2K"


@contextmanager
def progress(stream: TextIO, name: str, total_bytes: int) -> Iterator[Callable[[float], None]]:
    """Show how far a log of ``total_bytes`` has been read; yields ``advance(bytes)``."""
    if not stream.isatty():
        yield lambda count: None
        return
    from rich import progress as parts
    from rich.console import Console as RichConsole

    columns = (
        parts.TextColumn("{task.description}"),
        parts.BarColumn(),
        parts.DownloadColumn(),
        parts.TransferSpeedColumn(),
        parts.TimeRemainingColumn(),
    )
    with parts.Progress(*columns, console=RichConsole(file=stream), transient=True) as bar:
        task = bar.add_task(name, total=total_bytes)
        yield lambda count: bar.update(task, advance=count)


class Console:
    """Writes to ``stream``; only on a terminal does a line update in place.

    ``period_s`` is the time between two states of the line, by default that of the stream's kind.
    Any thread may use it: lines come whole, and nobody waits for a terminal that hangs.
    """

    draws = False
    """Whether it takes facts and draws a screen of them; else it takes a line."""

    def __init__(self, stream: TextIO, period_s: float | None = None) -> None:
        self._is_terminal = updates_in_place(stream)
        usual_s = TERMINAL_LINE_S if self._is_terminal else PLAIN_LINE_S
        self._period_s = usual_s if period_s is None else period_s
        self._next_s = time.monotonic() + self._period_s
        self._shown = ""
        self._lock = threading.Lock()
        self._outlet = Outlet(stream)

    def say(self, text: str) -> None:
        """Write a line that stays."""
        with self._lock:
            clear = _CLEAR if self._shown else ""
            self._outlet.write(f"{clear}yawid: {text}\n{self._shown}")

    def is_due(self) -> bool:
        """Whether it is time for the next state of the line."""
        return time.monotonic() >= self._next_s

    def draw(self, facts: LiveFacts, took_s: float) -> None:
        """Show where the session stands, where it draws; the facts took so long to gather."""
        raise NotImplementedError

    def show(self, line: str) -> None:
        """Show where the session stands: in place on a terminal, else as a line of its own."""
        self._next_s = time.monotonic() + self._period_s
        with self._lock:
            if self._is_terminal:
                self._shown = line[: shutil.get_terminal_size().columns - 1]
                self._outlet.write(_CLEAR + self._shown)
            else:
                self._outlet.write(f"yawid: {line}\n")

    def close(self) -> None:
        """Leave the line that updates: what follows stands below it, once all is written."""
        with self._lock:
            if self._shown:
                self._shown = ""
                self._outlet.write("\n")
            self._outlet.drain()


def updates_in_place(stream: TextIO) -> bool:
    """Whether it is a terminal that can write over what it has written."""
    return stream.isatty() and os.environ.get("TERM") not in ("dumb", "unknown")
