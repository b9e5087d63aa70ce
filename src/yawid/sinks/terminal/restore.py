"""What a killed process must undo on a terminal: the hidden cursor, the other screen, a bar.

A screen or a bar registers the codes that leave the terminal as it was. A signal handler writes
them before the process is killed (a second Ctrl-C).
"""

import contextlib
import os
import select
import sys
from typing import Final

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
