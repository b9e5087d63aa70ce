"""The facts of a live run, and the console that shows them, in a line or on a screen.

One thread of its own writes everything in its order, so that no caller waits for a terminal that
hangs (Ctrl-S, a slow ssh, a pager).
"""

import contextlib
import io
import os
import queue
import shutil
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import IO, TYPE_CHECKING, Any, Final, TextIO, cast

from yawid.answers.run_summary import Flight, Manoeuvre
from yawid.sinks.door import plain
from yawid.sinks.terminal.progress import CLEAR_LINE, OWN_SCREEN, SHOWN, updates_in_place

if TYPE_CHECKING:
    from rich.console import Console as RichConsole
    from rich.live import Live

    from yawid.sinks.terminal.live_page import Page


FEW: Final = 4
"""Up to this many vehicles stand in the line one by one."""
SILENT: Final = "silent"


@dataclass(frozen=True, slots=True)
class VehicleFacts:
    """The state of one vehicle's session.

    ``name`` is the vehicle, ``rudder`` and ``yaw`` the sources of these channels; each is empty
    before it is known. ``label`` begins its line among several. ``quiet`` says for how long nothing
    has come, ``held`` why no sample is used now; both are empty in normal operation. Rates are
    those of the last seconds, in Hz.

    ``stroke`` is how far the rudder's own part moved within 5 s, as a part of half its travel, None
    where that is unknown; ``rests_s`` is how long it has rested. The manoeuvre that is recorded
    began at ``from_s`` since boot (None: there is none) and has lasted ``lasted_s``; ``is_excited``
    is True once the rudder has moved far enough. ``unanswered`` manoeuvres have ended and are being
    estimated; ``finds`` is False where manoeuvres are not looked for. ``samples`` counts samples,
    ``answer`` is the answer now in words, "" before the first estimate, ``stream`` the stream
    in words: its status, and its numbers if they are the answer; ``state`` is its status in one or
    two. ``verdict`` says whether the flight's answer is usable, None before a manoeuvre is
    answered; ``why`` lists its reasons. ``lacks`` says what a pilot can do about what is missing,
    "" where that is only a manoeuvre.
    """

    sysid: int = 0
    label: str = ""
    name: str = ""
    rudder: str = ""
    yaw: str = ""
    quiet: str = ""
    held: str = ""
    message_hz: float = 0.0
    yaw_hz: float = 0.0
    rudder_hz: float = 0.0
    lost: int = 0
    finds: bool = True
    stroke: float | None = None
    rests_s: float = 0.0
    from_s: float | None = None
    lasted_s: float = 0.0
    is_excited: bool = False
    unanswered: int = 0
    manoeuvres: tuple[Manoeuvre, ...] = ()
    flights: tuple[Flight, ...] = ()
    samples: int = 0
    answer: str = ""
    stream: str = ""
    state: str = ""
    verdict: bool | None = None
    why: tuple[str, ...] = ()
    lacks: str = ""

    @property
    def urgency(self) -> tuple[bool, bool, bool, int]:
        """A sort key: silent vehicles first, then those that record, then those being estimated."""
        return not self.quiet, self.from_s is None, not self.unanswered, self.sysid

    def line(self, dropped: str) -> str:
        """Return the state in one line, of which a narrow terminal cuts off the least important."""
        if self.quiet == self.state != "":
            return f"{self.label}{self.quiet}, dropped {dropped}"
        parts = [self.quiet or f"{self.message_hz:.0f} msg/s", f"lost {self.lost}"]
        parts += [f"dropped {dropped}", self.answer or "waiting for rudder and yaw rate"]
        parts += [self.state] if self.answer and not self.quiet else []
        return f"{self.label}{', '.join([*parts, f'{self.samples} samples'])}"


@dataclass(frozen=True, slots=True)
class LiveFacts:
    """The state of a live run: its link and its vehicles.

    ``lasted_s`` is how long it has run, ``age_s`` the age of the last datagram, None before the
    first; ``dropped`` is the number of datagrams dropped here, as text; ``to_send`` is what to type
    at the sender.
    """

    endpoint: str
    lasted_s: float
    age_s: float | None
    dropped: str
    vehicles: tuple[VehicleFacts, ...]
    to_send: str = ""

    @property
    def line(self) -> str:
        """The state in one line; more than ``FEW`` vehicles are counted by their state."""
        if len(self.vehicles) <= FEW:
            return " | ".join(each.line(self.dropped) for each in self.vehicles) or "no vehicle yet"
        rate, lost = sum(v.message_hz for v in self.vehicles), sum(v.lost for v in self.vehicles)
        counts = f"{rate:.0f} msg/s, lost {lost}, dropped {self.dropped}"
        return f"{len(self.vehicles)} vehicles, {counts}: {states_of(self.vehicles)}"


def states_of(vehicles: Iterable[VehicleFacts]) -> str:
    """Return how many vehicles there are in each state, in words, the most frequent first."""
    states = Counter(each.state or "waiting" for each in vehicles).most_common()
    return ", ".join(f"{count} {state}" for state, count in states)


PLAIN_LINE_S: Final = 10.0
TERMINAL_LINE_S: Final = 0.5
REFRESH_S: Final = 0.4
"""The usual times between two updates of lines, of a line in place, and of a screen."""
MOST_WAITING: Final = 1000
"""How many texts may wait for the terminal; further ones are left out."""
LEAVE_S: Final = 1.0
"""How long the end of a session waits for texts that are not yet written."""
KEPT: Final = 200
"""The largest number of messages that are kept, and written when the screen is left."""
USUAL_SIZE: Final = 80, 24


class Direct(io.TextIOBase):
    """A stream that writes to the file of ``stream`` unbuffered; a closed file is not an error.

    It holds no lock of the stream while it writes: a thread that waits for a terminal blocks no
    other thread and not the end of the process.
    """

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self._encoding = stream.encoding or "utf-8", stream.errors or "replace"
        self._file: int | None = None
        if os.name == "posix":
            with contextlib.suppress(OSError, ValueError):  # a StringIO has no file
                self._file = stream.fileno()

    def write(self, text: str) -> int:
        """Write the whole text, however long that takes; return its length."""
        try:
            if self._file is None:
                self._stream.write(text)
                self._stream.flush()
            else:
                data = text.encode(*self._encoding)
                while data:
                    data = data[os.write(self._file, data) :]
        except OSError:
            pass  # the terminal is closed; the session goes on
        return len(text)


class Console:
    """A writer to ``stream``, which any thread may use; ``period_s`` is between two updates.

    Where it ``draws`` it takes facts and shows them on the terminal's alternate screen; before and
    after it writes lines. Closing leaves the screen and writes the messages and the last state.
    """

    failure: Exception | None = None
    """The error after which nothing is drawn any more; lines are still written."""

    def __init__(
        self, stream: TextIO, period_s: float | None = None, *, draws: bool = False
    ) -> None:
        self.draws = draws
        self._is_terminal = updates_in_place(stream)
        usual_s = TERMINAL_LINE_S if self._is_terminal else PLAIN_LINE_S
        self._period_s = period_s or (REFRESH_S if draws else usual_s)
        self._share = 0.03 if draws else 0.3  # of a session's time that gathering facts may take
        self._next_s = time.monotonic() + self._period_s
        self._stream, self._direct = stream, Direct(stream)
        self._line = ""
        self._said: deque[tuple[str, str]] = deque(maxlen=KEPT)
        self._unsaid: deque[str] = deque(maxlen=KEPT)  # not yet written as lines
        self._facts: LiveFacts | None = None
        self._live: Live | None = None
        self._todo: queue.SimpleQueue[tuple[Callable[[Any], None], Any]] = queue.SimpleQueue()
        threading.Thread(target=self._run, name="yawid-console", daemon=True).start()

    def say(self, text: str) -> None:
        """Write a line that is not updated later, or show it on the screen."""
        self._put(self._write_line, plain(text))

    def is_due(self) -> bool:
        """Return whether the next update is due."""
        return time.monotonic() >= self._next_s

    def show(self, line: str, took_s: float = 0.0) -> None:
        """Show the session's state: in place on a terminal, else as a line of its own.

        The longer it took to gather, the later the next one is due.
        """
        self._rest(took_s)
        self._put(self._update, plain(line))

    def draw(self, facts: LiveFacts, took_s: float) -> bool:
        """Show the facts on the screen; return True."""
        self._rest(took_s)
        self._facts = facts
        if self._todo.empty():  # else what waits is followed by a drawing of these facts
            self._todo.put((self._draw, None))
        return True

    def close(self) -> None:
        """Leave screen or line, and wait for what is not yet written, at most ``LEAVE_S``."""
        written = threading.Event()
        self._todo.put((self._leave, written))
        written.wait(LEAVE_S)

    def _put(self, act: Callable[[Any], None], what: object) -> None:
        if self._todo.qsize() < MOST_WAITING:
            self._todo.put((act, what))

    def _rest(self, took_s: float) -> None:
        self._next_s = time.monotonic() + max(self._period_s, took_s / self._share)

    def _run(self) -> None:
        while True:
            act, what = self._todo.get()
            try:
                act(what)
                if self._live is not None and self._todo.empty():
                    self._live.console.size = size_of(self._stream)
                    self._live.update(self._page(), refresh=True)
            except Exception as error:  # the session reports it; the thread would print a traceback
                self.failure = error
                self._leave_screen()

    def _write_line(self, text: str) -> None:
        self._said.append((time.strftime("%H:%M:%S"), text))
        if self._live is not None:
            self._unsaid.append(text)
        else:
            clear = CLEAR_LINE if self._line else ""
            self._direct.write(f"{clear}yawid: {text}\n{self._line}")

    def _update(self, line: str) -> None:
        if self._is_terminal:
            self._line = line[: shutil.get_terminal_size().columns - 1]
            self._direct.write(CLEAR_LINE + self._line)
        else:
            self._direct.write(f"yawid: {line}\n")

    def _draw(self, _: None) -> None:
        if self._live is None and self.failure is None:
            from rich.live import Live

            self._live = Live(
                console=self._rich, screen=True, auto_refresh=False, transient=True,
                redirect_stdout=False, redirect_stderr=False,
            )  # fmt: skip
            SHOWN.append(OWN_SCREEN)  # first: a signal may come at once
            self._live.start()

    @property
    def _rich(self) -> "RichConsole":
        from rich.console import Console as RichConsole

        return RichConsole(
            file=cast(IO[str], self._direct),
            force_terminal=True, highlight=False, markup=False, emoji=False,
        )  # fmt: skip

    def _page(self, *, is_last: bool = False) -> "Page":
        from yawid.sinks.terminal.live_page import Page

        assert self._facts is not None  # the first ones began the screen
        return Page(self._facts, () if is_last else tuple(self._said), is_last)

    def _leave_screen(self) -> None:
        live, self._live = self._live, None
        if live is None:
            return
        with contextlib.suppress(Exception):  # what failed once may fail again
            live.stop()
        SHOWN.remove(OWN_SCREEN)
        while self._unsaid:
            self._direct.write(f"yawid: {self._unsaid.popleft()}\n")
        if self.failure is None:
            self._rich.print(self._page(is_last=True))

    def _leave(self, written: threading.Event) -> None:
        self._leave_screen()
        if self._line:
            self._line = ""
            self._direct.write("\n")
        written.set()


def console_for(stream: TextIO) -> Console:
    """Return a live session's console: a screen, or lines where a screen is not possible."""
    if not updates_in_place(stream) or not (stream.encoding or "").lower().startswith("utf"):
        return Console(stream)
    from yawid.sinks.terminal.live_page import LEAST_HEIGHT, LEAST_WIDTH

    width, height = size_of(stream)
    return Console(stream, draws=width >= LEAST_WIDTH and height >= LEAST_HEIGHT)


def size_of(stream: TextIO) -> tuple[int, int]:
    """Return the columns and lines of a terminal, ``USUAL_SIZE`` where they are unknown."""
    try:
        columns, lines = os.get_terminal_size(stream.fileno())
    except (OSError, ValueError):
        return USUAL_SIZE
    return (columns, lines) if columns and lines else USUAL_SIZE
