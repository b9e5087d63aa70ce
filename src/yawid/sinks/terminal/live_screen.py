"""The live screen: a thread draws facts on a terminal by rich, a few times a second."""

import os
import threading
import time
from collections import deque
from typing import IO, TextIO, cast

from yawid.sinks.door import cleaned, plain
from yawid.sinks.terminal.live_facts import LiveFacts
from yawid.sinks.terminal.outlet import LEAVE_S, Direct
from yawid.sinks.terminal.progress import Console, updates_in_place
from yawid.sinks.terminal.restore import OWN_SCREEN, SHOWN

REFRESH_S = 0.4
KEPT = 200
"""The largest number of messages that are kept, and written when the screen is left."""
USUAL_SIZE = 80, 24


def console_for(stream: TextIO) -> Console:
    """Return a live session's console: a screen, or lines where a screen is not possible."""
    if not updates_in_place(stream) or not (stream.encoding or "").lower().startswith("utf"):
        return Console(stream)
    from yawid.sinks.terminal.live_page import LEAST_HEIGHT, LEAST_WIDTH

    width, height = size_of(stream)
    if width < LEAST_WIDTH or height < LEAST_HEIGHT:
        return Console(stream)
    return LiveScreen(stream)


def size_of(stream: TextIO) -> tuple[int, int]:
    """Return the columns and lines of a terminal, ``USUAL_SIZE`` where they are unknown."""
    try:
        columns, lines = os.get_terminal_size(stream.fileno())
    except (OSError, ValueError):
        return USUAL_SIZE
    return (columns, lines) if columns and lines else USUAL_SIZE


class LiveScreen(Console):
    """A console that draws on the terminal's alternate screen; before and after it writes lines.

    Closing leaves the alternate screen and writes the messages and the last state as lines. A
    thread does all drawing, so that the session does not wait for a terminal that hangs.
    """

    draws, share = True, 0.03

    def __init__(self, stream: TextIO) -> None:
        super().__init__(stream, REFRESH_S)
        self._stream = stream
        self._said: deque[tuple[str, str]] = deque(maxlen=KEPT)
        self._unsaid: deque[str] = deque(maxlen=KEPT)  # not yet written as lines
        self._facts: LiveFacts | None = None
        self._news = threading.Event()
        self._closing = threading.Event()
        self._thread: threading.Thread | None = None

    def say(self, text: str) -> None:
        """Show a message on the screen; without the screen, write it as a line."""
        text = plain(text)
        with self._lock:
            self._said.append((time.strftime("%H:%M:%S"), text))
            is_shown = self._thread is not None
            if is_shown:
                self._unsaid.append(text)
                self._news.set()
        if not is_shown:
            super().say(text)

    def draw(self, facts: LiveFacts, took_s: float) -> bool:
        """Show the facts; the longer they took to gather, the later the next call is due."""
        self._rest(took_s)
        is_first, self._facts = self._facts is None, facts
        if is_first:
            self._thread = threading.Thread(
                target=self._run, args=(facts,), name="yawid-screen", daemon=True
            )
            self._thread.start()
        self._news.set()
        return True

    def close(self) -> None:
        """Leave the screen; the thread that draws it is waited for, at most ``LEAVE_S``."""
        thread = self._thread
        if thread is not None:
            self._closing.set()
            self._news.set()
            thread.join(LEAVE_S)
            self._thread = None
        super().close()

    def _run(self, facts: LiveFacts) -> None:
        try:
            self._draw_until_closed(facts)
        except Exception as error:  # the session reports it; the thread would print a traceback
            self.failure = error

    def _draw_until_closed(self, facts: LiveFacts) -> None:
        from rich.console import Console as RichConsole
        from rich.live import Live

        from yawid.sinks.terminal.live_page import Page

        direct = Direct(self._stream)
        console = RichConsole(
            file=cast(IO[str], direct),
            force_terminal=True,
            highlight=False,
            markup=False,
            emoji=False,
        )
        live = Live(console=console, screen=True, auto_refresh=False, transient=True,
                    redirect_stdout=False, redirect_stderr=False)  # fmt: skip
        SHOWN.append(OWN_SCREEN)  # first: a signal may come at once
        try:
            live.start()
            while not self._closing.is_set():
                self._news.wait()
                self._news.clear()
                facts = cleaned(self._facts or facts)
                console.size = size_of(self._stream)
                live.update(Page(facts, tuple(self._said)), refresh=True)
                self._closing.wait(REFRESH_S / 4)  # events within this time are drawn together
        finally:
            live.stop()
            SHOWN.remove(OWN_SCREEN)
            with self._lock:
                unsaid, self._thread = list(self._unsaid), None
            for text in unsaid:
                direct.write(f"yawid: {text}\n")
        console.print(Page(cleaned(facts), (), is_last=True))
