"""What keeps a failure where it happened: one part of a session fails, and the others go on."""

import traceback
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from yawid.errors import SinkError, YawidError
from yawid.sinks.door import show_traceback

_T = TypeVar("_T")
_LONGEST = 200
"""Characters of an error's own text in a line: NumPy's may hold a whole array."""


class Bulkhead:
    """Stands around one part of a session: its first error ends that part and nothing else.

    The error is said one time, with its cause and how the session goes on; ``failure`` is the cause
    from then on. An error that ``lets_pass`` returns true for is raised.
    """

    def __init__(
        self,
        what: str,
        goes_on: str,
        tell: Callable[[str], None],
        lets_pass: Callable[[Exception], bool] = lambda _: False,
    ) -> None:
        self.what = what
        self.failure: str | None = None
        self._goes_on = goes_on
        self._tell = tell
        self._lets_pass = lets_pass

    def attempt(self, act: Callable[[], _T], otherwise: _T) -> _T:
        """Return what ``act`` returns, ``otherwise`` where it fails or did so before."""
        if self.failure is None:
            try:
                return act()
            except Exception as error:
                if self._lets_pass(error):
                    raise
                self.give_up(error)
        return otherwise

    def give_up(self, error: Exception) -> None:
        """Do without the part from here on."""
        if self.failure is None:
            cause = cause_of(error)
            # What could not be written says that by itself.
            is_said = isinstance(error, SinkError)
            self.failure = cause if is_said else f"{self.what} failed because of {cause}"
            self._tell(f"{self.failure}: {self._goes_on}")


def cause_of(error: Exception) -> str:
    """Return an error in one line: yawid's own text, or what Python raised and where.

    ``YAWID_DEBUG=1`` shows the traceback of the latter too.
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
