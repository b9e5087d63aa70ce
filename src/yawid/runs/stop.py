"""How a command is told to stop: by SIGINT or SIGTERM, heeded one time; a second one ends it."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

SIGNALS = (signal.SIGINT, signal.SIGTERM)


class Interrupted(KeyboardInterrupt):
    """A command was told to stop where there is nothing of it to keep; ``exit_code`` 130 or 143."""

    def __init__(self, exit_code: int) -> None:
        super().__init__()
        self.exit_code = exit_code


class StopFlag:
    """Set by the first SIGINT or SIGTERM; whoever holds it keeps what is finished and ends.

    ``exit_code`` is 128 plus the signal's number, ``name`` the signal's own. Where it ``raises`` it
    is not waited for that somebody looks: :class:`Interrupted` comes at once. A second signal finds
    the system's own handler and ends the process there and then, whatever it does. A signal that
    the process was started to ignore, as a shell starts a job in the background, stays ignored.
    """

    def __init__(self, *, raises: bool = False) -> None:
        self.is_set = False
        self.exit_code = 128 + signal.SIGINT
        self.name = signal.SIGINT.name
        self._raises = raises
        self._before: dict[signal.Signals, Any] = {}

    def _set(self, number: int, frame: FrameType | None) -> None:
        for one in self._before:
            signal.signal(one, signal.SIG_DFL)
        self.is_set = True
        self.exit_code, self.name = 128 + number, signal.Signals(number).name
        if self._raises:
            raise Interrupted(self.exit_code)

    @contextmanager
    def raising(self) -> Iterator[None]:
        """Raise while the context lasts: it makes nothing that could be kept.

        Raises:
            Interrupted: a signal comes, or has come before.
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
        """Catch the two signals while the context lasts, but for one that is ignored."""
        handlers = {number: signal.getsignal(number) for number in SIGNALS}
        self._before = {n: old for n, old in handlers.items() if old is not signal.SIG_IGN}
        for number in self._before:
            signal.signal(number, self._set)
        try:
            yield self
        finally:
            for number, handler in self._before.items():
                signal.signal(number, handler)
