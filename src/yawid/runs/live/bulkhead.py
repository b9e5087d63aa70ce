"""How a failure is confined: one part of a session fails, and the others go on."""

import traceback
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from yawid.errors import SinkError, YawidError
from yawid.sinks.door import show_traceback

_T = TypeVar("_T")
_LONGEST = 200
"""The largest number of characters of an error's text in a line: NumPy's may hold an array."""


class Bulkhead:
    """A guard around one part of a session: the part's first error ends this part and no other.

    The error is reported once, with its cause and how the session goes on; from then on ``failure``
    is the cause. An error for which ``lets_pass`` returns True is raised.
    """

    def __init__(
        self,
        what: str,
        goes_on: str,
        say: Callable[[str], None],
        lets_pass: Callable[[Exception], bool] = lambda _: False,
    ) -> None:
        self.what = what
        self.failure: str | None = None
        self._goes_on = goes_on
        self._say = say
        self._lets_pass = lets_pass

    def attempt(self, act: Callable[[], _T], otherwise: _T) -> _T:
        """Return the result of ``act``, or ``otherwise`` where it fails or has failed before."""
        if self.failure is None:
            try:
                return act()
            except Exception as error:
                if self._lets_pass(error):
                    raise
                self.give_up(error)
        return otherwise

    def give_up(self, error: Exception) -> None:
        """End the part because of an error, and report it."""
        if self.failure is None:
            cause = cause_of(error)
            # The text of a SinkError already names what failed.
            is_said = isinstance(error, SinkError)
            self.failure = cause if is_said else f"{self.what} failed because of {cause}"
            self._say(f"{self.failure}: {self._goes_on}")


def cause_of(error: Exception) -> str:
    """Return an error in one line: the text of yawid's errors, of others also type and place.

    With ``YAWID_DEBUG=1`` the traceback of the others is shown too.
    """
    text = " ".join(str(error).split())
    if isinstance(error, YawidError):
        return text
    show_traceback(error)
    if len(text) > _LONGEST:
        text = f"{text[:_LONGEST]}..."
    raised_at = traceback.extract_tb(error.__traceback__)
    place = f" at {Path(raised_at[-1].filename).name}:{raised_at[-1].lineno}" if raised_at else ""
    return f"{type(error).__name__}{place}" + (f": {text}" if text else "")
