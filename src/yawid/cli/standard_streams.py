"""Standard output and standard error, which may be closed, full, restricted to ASCII, or a pipe."""

import codecs
import io
import os
import sys

from yawid.errors import SinkError
from yawid.sinks.door import mute
from yawid.system.processes import show_escapes

PLAIN = {"±": "+-", "ω": "w", "ζ": "zeta", "σ": "sigma", "²": "2", "–": "-", "…": "..."}
"""What is printed for these characters on a terminal that cannot show them."""
REPLACED = "yawid"
"""The name of yawid's error handler for Python's codecs."""


def make_ready() -> None:
    """Prepare both streams so that no text fails because of its characters.

    Raises:
        SinkError: standard output is closed.
    """
    if sys.stderr is None:
        sys.stderr = os.fdopen(os.open(os.devnull, os.O_WRONLY), "w", encoding="utf-8")
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors=REPLACED)
    if sys.stdout is None:
        raise SinkError(
            "stdout is closed, so the answer would be lost: send it to a file, or to /dev/null"
        )
    show_escapes()


def bring_out() -> None:
    """Write out what both streams still hold: at Python's exit an error could not be reported.

    Raises:
        OSError: stdout takes no more.
    """
    try:
        sys.stderr.flush()
    except OSError:
        mute(sys.stderr)
    sys.stdout.flush()


def _replaced(error: UnicodeError) -> tuple[bytes, int]:
    if not isinstance(error, UnicodeEncodeError):
        raise error
    text = error.object[error.start : error.end]
    return b"".join(map(_shown, text)), error.end


def _shown(character: str) -> bytes:
    # A file's name may hold bytes that are not text; they are written unchanged, for copying.
    if "\udc80" <= character <= "\udcff":
        return bytes([ord(character) - 0xDC00])
    return PLAIN.get(character, "?").encode()


codecs.register_error(REPLACED, _replaced)
