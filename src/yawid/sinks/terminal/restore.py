"""What a stop must undo on a terminal: the hidden cursor, the other screen, a half-drawn line.

A screen or a bar registers how to leave the terminal and how to come back. A signal handler then
leaves before the process is stopped (Ctrl-Z) or killed (a second Ctrl-C), and comes back after.
"""

import contextlib
import os
import select
from typing import Final, Protocol, TextIO

SHOW_CURSOR: Final = "\x1b[?25h"
HIDE_CURSOR: Final = "\x1b[?25l"
OTHER_SCREEN: Final = "\x1b[?1049h" + HIDE_CURSOR
OWN_SCREEN: Final = "\x1b[?1049l" + SHOW_CURSOR
CLEAR_LINE: Final = "\r\x1b[2K"


class Shown(Protocol):
    """Something that changed the state of a terminal, as long as it is in ``SHOWN``."""

    def leave(self) -> None:
        """Leave the terminal as it was found, without waiting for one that hangs."""

    def come_back(self) -> None:
        """Take the terminal again after :meth:`leave`."""


SHOWN: Final[list[Shown]] = []
"""What is on the terminal now."""


def leave() -> None:
    """Leave the terminal whole."""
    for each in SHOWN:
        each.leave()


def come_back() -> None:
    """Take the terminal again."""
    for each in SHOWN:
        each.come_back()


def write_now(stream: TextIO, text: str) -> None:
    """Write to a terminal if it takes text now; else, and if it is closed, do nothing."""
    with contextlib.suppress(OSError, ValueError):
        if os.name != "posix" or select.select([], [stream.fileno()], [], 0.0)[1]:
            os.write(stream.fileno(), text.encode("ascii"))
