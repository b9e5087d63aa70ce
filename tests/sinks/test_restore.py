"""A terminal stays whole after Ctrl-Z and a second Ctrl-C, in a real shell with job control."""

from __future__ import annotations

import os
import pty
import re
import select
import sys
import time
from pathlib import Path

import pytest

WORK = """
import sys, time
from yawid.runs.stop import StopFlag
from yawid.sinks.terminal.live_facts import LiveFacts
from yawid.sinks.terminal.live_screen import LiveScreen
from yawid.sinks.terminal.progress import progress

facts = LiveFacts("udpin:127.0.0.1:1", 1.0, None, "0", (), "line")
with StopFlag().installed(), progress(sys.stderr, "a log", 10.0) as bar:
    if sys.argv[1] == "bar":
        bar.show()
    else:
        LiveScreen(sys.stderr).draw(facts, 0.0)
    for _ in range(600):  # busy: it never looks whether it is to stop
        time.sleep(0.1)
"""
HIDDEN, SHOWN = b"\x1b[?25l", b"\x1b[?25h"
OTHER, OWN = b"\x1b[?1049h", b"\x1b[?1049l"


class Shell:
    """An interactive bash in a terminal of its own; ``seen`` is all that it wrote."""

    def __init__(self) -> None:
        self.child, self.terminal = pty.fork()
        if self.child == 0:
            os.environ |= {"PS1": "> ", "TERM": "xterm-256color", "LANG": "C.UTF-8"}
            os.execvp("bash", ["bash", "--norc", "--noprofile", "-i"])
        self.seen = b""

    def type(self, keys: str, until: str) -> None:
        """Type ``keys`` and wait for a pattern in what is written from then on."""
        begin, end_s = len(self.seen), time.monotonic() + 60.0
        os.write(self.terminal, keys.encode())
        while not re.search(until.encode(), self.seen[begin:]):
            assert time.monotonic() < end_s, self.seen[begin:][-2000:]
            if select.select([self.terminal], [], [], 0.1)[0]:
                self.seen += os.read(self.terminal, 1 << 16)

    @property
    def is_whole(self) -> bool:
        """Whether the cursor is shown, and on the terminal's own screen."""
        last = self.seen.rfind
        return last(SHOWN) >= last(HIDDEN) and last(OWN) >= last(OTHER)


@pytest.mark.parametrize("what", ["bar", "screen"])
def test_ctrl_z_and_a_second_ctrl_c_leave_the_terminal_whole(tmp_path: Path, what: str) -> None:
    (tmp_path / "work.py").write_text(WORK, encoding="utf-8")
    drawn = r"\[\?25l" if what == "bar" else r"\[\?1049h"
    shell = Shell()
    try:
        shell.type(f"{sys.executable} {tmp_path}/work.py {what}\r", drawn)
        assert not shell.is_whole
        shell.type("\x1a", "Stopped")
        assert shell.is_whole
        shell.type("fg\r", drawn)
        assert not shell.is_whole
        shell.type("\x03", ".")  # the first one asks it to end, which it never does
        time.sleep(0.3)
        assert not shell.is_whole
        shell.type("\x03", "> $")
        assert shell.is_whole
        shell.type("echo code $?\r", "code 130")
    finally:
        os.close(shell.terminal)
        os.waitpid(shell.child, 0)
