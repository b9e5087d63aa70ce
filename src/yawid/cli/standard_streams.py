"""Standard output and standard error as they may be: closed, full, of ASCII only, or a pipe."""

import codecs
import io
import os
import sys

from yawid.errors import SinkError
from yawid.sinks.door import mute

PLAIN = {"±": "+-", "ω": "w", "ζ": "zeta", "σ": "sigma", "²": "2", "–": "-", "…": "..."}
"""What yawid prints, for a terminal that cannot show it."""
REPLACED = "yawid"
"""The name under which Python's codecs know how."""


def make_ready() -> None:
    """See to it that no text that is written to either stream can fail for what it holds.

    Raises:
        SinkError: standard output is closed.
    """
    if sys.stderr is None:
        sys.stderr = os.fdopen(os.open(os.devnull, os.O_WRONLY), "w")
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors=REPLACED)
    if sys.stdout is None:
        raise SinkError("stdout is closed, so nobody would get the answer; > /dev/null drops it")


def hush(library: str) -> None:
    """Drop what a library logs that is no error: it goes to stderr, where every line is ours."""
    import logging  # takes 17 ms, and few commands need it

    logging.getLogger(library).setLevel(logging.ERROR)


def bring_out() -> None:
    """Bring out what both streams still hold; Python itself would do so where nobody can answer.

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
    # A file's name may hold bytes that are no text; they go out as they came in, to be copied.
    if "\udc80" <= character <= "\udcff":
        return bytes([ord(character) - 0xDC00])
    return PLAIN.get(character, "?").encode()


codecs.register_error(REPLACED, _replaced)
