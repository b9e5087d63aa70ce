"""The one place through which text goes to a terminal or a log, so that none of it is a command.

Text in a log, a record, a finished run, a file's name or on a link may come from anybody. Escape
sequences in it could colour a refusal green, move the cursor over it, or write to the clipboard; an
override of the reading direction could reverse a name. Such characters are shown as escape codes
with a backslash and have no effect. Yawid's own styles are added by rich, after this step.
"""

import contextlib
import io
import json
import os
import re
import sys
import traceback
from collections.abc import Callable
from typing import TYPE_CHECKING, Final, TextIO, TypeVar

if TYPE_CHECKING:
    from rich.console import Console

    from yawid.answers.part import Part
    from yawid.sinks.pages import Page

_Answer = TypeVar("_Answer", bound="Part")
WIDTH: Final = 80
"""The width in columns of pages that are not printed to a terminal."""
DEBUG: Final = "YAWID_DEBUG"
"""The variable of the environment that shows tracebacks, unless it is 0 or empty."""
_CONTROL: Final = re.compile(
    "[\x00-\x1f\x7f-\x9f"  # C0, DEL, C1
    "\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ufeff"  # direction, ends of lines
    "\U000e0000-\U000e007f"  # tags, which are invisible
    "\udc80-\udc9f]"  # C1 as bytes in a file's name that are not text
)


def plain(text: str) -> str:
    """Return a text as one line without control characters: they are shown as escape codes."""
    return text if text.isascii() and text.isprintable() else _CONTROL.sub(_code, text)


def _code(found: re.Match[str]) -> str:
    code = ord(found[0])
    if 0xDC80 <= code <= 0xDC9F:
        code -= 0xDC00
    return {9: r"\t", 10: r"\n", 13: r"\r"}.get(code) or (
        f"\\x{code:02x}" if code < 256 else f"\\u{code:04x}"
    )


def show_traceback(error: Exception) -> None:
    """Write the traceback of an error to stderr, where the variable ``DEBUG`` asks for it."""
    if os.environ.get(DEBUG, "0") not in ("", "0"):
        for line in "".join(traceback.format_exception(error)).splitlines():
            say(line)


def say(text: str) -> None:
    """Write a line to stderr; that stderr is closed or full is not an error."""
    try:
        sys.stderr.write(f"yawid: {plain(text)}\n")
        sys.stderr.flush()
    except OSError:
        mute(sys.stderr)


def print_line(line: str) -> None:
    """Write a line of the answer to stdout.

    Raises:
        OSError: stdout takes no more.
    """
    print_text(plain(line) + "\n")


def print_json(answer: object) -> None:
    """Write an answer to stdout as one line of JSON, in ASCII.

    Raises:
        OSError: stdout takes no more.
    """
    print_text(json_line(answer))


def json_line(answer: object) -> str:
    """Return an answer as one line of JSON, in ASCII."""
    return json.dumps(answer).replace("\x7f", "\\u007f") + "\n"


def print_answer(answer: _Answer, page: "Callable[[_Answer], Page]", *, as_json: bool) -> None:
    """Print an answer to stdout, as one line of JSON or as the page that ``page`` makes of it.

    Raises:
        OSError: stdout takes no more.
    """
    if as_json:
        print_json(answer.to_json())
        return
    from yawid.sinks.pages import to_terminal  # --json needs nothing of it

    text = _TextForStdout()
    to_terminal(page(answer), text)
    print_text(text.getvalue())


def page_console(stream: TextIO) -> "Console":
    """Return a console as wide as the terminal, or ``WIDTH``; it prints ``[red]`` as text."""
    from rich.console import Console  # only some commands print a page

    width = None if stream.isatty() else WIDTH
    return Console(file=stream, highlight=False, markup=False, emoji=False, width=width)


def print_text(text: str) -> None:
    """Write to stdout a text made by yawid: what comes from outside must be made plain before.

    Raises:
        OSError: stdout takes no more.
    """
    sys.stdout.write(text)
    sys.stdout.flush()


def mute(stream: TextIO) -> None:
    """Drop what a failed stream still holds in its buffer: else it fails again when Python ends."""
    with contextlib.suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


class _TextForStdout(io.StringIO):
    """A text for stdout, with the width and colours that stdout itself would have."""

    def isatty(self) -> bool:
        return sys.stdout.isatty()
