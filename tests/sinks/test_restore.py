"""A terminal stays whole after a second Ctrl-C, in a real shell with job control."""

from __future__ import annotations

import sys
import time
from pathlib import Path

import pytest
from shell import Shell

WORK = """
import sys, time
from yawid.runs.stop import StopFlag
from yawid.sinks.terminal.console import LiveFacts
from yawid.sinks.terminal.console import Console
from yawid.sinks.terminal import progress as bars

facts = LiveFacts("udpin:127.0.0.1:1", 1.0, None, "0", ())
bars.SOON_S = 0.0 if sys.argv[1] == "bar" else 600.0
with StopFlag().installed(), bars.progress(sys.stderr, "a log", 10.0) as bar:
    if sys.argv[1] != "bar":
        Console(sys.stderr, draws=True).draw(facts, 0.0)
    for _ in range(600):  # busy: it never looks whether it is to stop
        time.sleep(0.1)
"""
HIDDEN, SHOWN = b"\x1b[?25l", b"\x1b[?25h"
OTHER, OWN = b"\x1b[?1049h", b"\x1b[?1049l"


def is_whole(shell: Shell) -> bool:
    """Return whether the cursor is shown, and on the terminal's own screen."""
    last = shell.seen.rfind
    return last(SHOWN) >= last(HIDDEN) and last(OWN) >= last(OTHER)


@pytest.mark.parametrize("what", ["bar", "screen"])
def test_a_second_ctrl_c_leaves_the_terminal_whole(tmp_path: Path, what: str) -> None:
    (tmp_path / "work.py").write_text(WORK, encoding="utf-8")
    drawn = r"\[\?25l" if what == "bar" else r"\[\?1049h"
    with Shell("bash", "--norc", "--noprofile", "-i") as shell:
        shell.type(f"{sys.executable} {tmp_path}/work.py {what}\r", drawn)
        assert not is_whole(shell)
        shell.type("\x03", ".")  # the first one asks it to end, which it never does
        time.sleep(0.3)
        assert not is_whole(shell)
        shell.type("\x03", "> $")
        assert is_whole(shell)
        shell.type("echo code $?\r", "code 130")
