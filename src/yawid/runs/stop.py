"""How a command is stopped: the first SIGINT or SIGTERM asks it to end, a second one kills it."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

from yawid.sinks.terminal import progress as restore

SIGNALS = (signal.SIGINT, signal.SIGTERM)


def _end(number: int, frame: FrameType | None) -> None:
    """End the process by a signal at once, after the terminal was left whole."""
    restore.leave()
    signal.signal(number, signal.SIG_DFL)
    signal.raise_signal(number)


class Interrupted(KeyboardInterrupt):
    """A signal stopped a command that has nothing to keep; ``exit_code`` is 130 or 143."""

    def __init__(self, exit_code: int) -> None:
        super().__init__()
        self.exit_code = exit_code


class StopFlag:
    """A flag set by the first SIGINT or SIGTERM: its reader keeps what is finished and ends.

    ``exit_code`` is 128 plus the signal's number, ``name`` the signal's name. With ``raises`` the
    signal raises :class:`Interrupted` at once, and nobody has to look at the flag. A second signal
    ends the process at once, with the terminal left whole. A signal that the process was started to
    ignore, as shells do for jobs in the background, stays ignored.
    """

    def __init__(self, *, raises: bool = False) -> None:
        self.is_set = False
        self.exit_code = 128 + signal.SIGINT
        self.name = signal.SIGINT.name
        self._raises = raises
        self._before: dict[signal.Signals, Any] = {}

    def _set(self, number: int, frame: FrameType | None) -> None:
        for one in self._before:
            signal.signal(one, _end if restore.SHOWN else signal.SIG_DFL)
        self.is_set = True
        self.exit_code, self.name = 128 + number, signal.Signals(number).name
        if self._raises:
            raise Interrupted(self.exit_code)

    @contextmanager
    def raising(self) -> Iterator[None]:
        """Raise at a signal while the context lasts: for work with no result that could be kept.

        Raises:
            Interrupted: a signal comes, or came before.
        """
        self._raises = True
        try:
            if self.is_set:
                raise Interrupted(self.exit_code)
            yield
        finally:
            self._raises = False

    @contextmanager
    def installed(self) -> "Iterator[StopFlag]":
        """Catch the two signals while the context lasts, except one that is ignored."""
        handlers = {number: signal.getsignal(number) for number in SIGNALS}
        self._before = {n: old for n, old in handlers.items() if old is not signal.SIG_IGN}
        for number in self._before:
            signal.signal(number, self._set)
        try:
            yield self
        finally:
            for number, handler in self._before.items():
                signal.signal(number, handler)
