"""The live screen on a real terminal, and lines where there is none."""

from __future__ import annotations

import fcntl
import io
import os
import pty
import re
import select
import struct
import termios
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from checks.children import free_udp_port
from live_link import CONFIG, frames, send
from scipy.signal import cont2discrete, lfilter

from yawid.config.run import RunConfig
from yawid.runs.live import LiveOptions, live
from yawid.runs.outputs import Outputs
from yawid.runs.replay import StopFlag
from yawid.sinks.terminal.console import console_for


class Terminal:
    """A pseudo terminal of 80x24 and what has been written to it."""

    def __init__(self) -> None:
        self._master, slave = pty.openpty()
        self.resize(24)
        self.stream = open(slave, "w", encoding="utf-8")  # noqa: PTH123, SIM115 # closed below
        self.written = self.all = b""
        """Since what was waited for last, and all of it."""

    def resize(self, lines: int) -> None:
        fcntl.ioctl(self._master, termios.TIOCSWINSZ, struct.pack("HHHH", lines, 80, 0, 0))

    def wait_for(self, text: str, within_s: float = 60.0) -> None:
        late_s = time.monotonic() + within_s
        while text.encode() not in self.written:
            assert time.monotonic() < late_s, f"{text!r} is not in {self.written[-2000:]!r}"
            if select.select([self._master], [], [], 0.1)[0]:
                read = os.read(self._master, 65536)
                self.written, self.all = self.written + read, self.all + read
        self.written = self.written[self.written.index(text.encode()) :]

    def close(self) -> None:
        self.stream.close()
        os.close(self._master)


@pytest.fixture
def terminal(monkeypatch: pytest.MonkeyPatch) -> Iterator[Terminal]:
    monkeypatch.setenv("TERM", "xterm-256color")
    opened = Terminal()
    yield opened
    opened.close()


def test_the_screen_says_a_dead_link_at_once_and_leaves_the_terminal_clean(
    tmp_path: Path, terminal: Terminal
) -> None:
    port, stop = free_udp_port(), StopFlag()
    options = LiveOptions(f"udpin:127.0.0.1:{port}", seconds=600.0)
    console = console_for(terminal.stream)
    outputs = Outputs(tmp_path, "live")
    session = threading.Thread(
        target=live, args=(options, CONFIG, outputs, stop, console), daemon=True
    )
    session.start()
    try:
        terminal.wait_for("listening on")
        send(frames(20.0, doublet_s=8.0), port)
        terminal.wait_for("NOTHING RECEIVED FOR")  # long before the session's 60 s
        console.say("said meanwhile")
    finally:
        stop.is_set = True
    terminal.wait_for("\x1b[?25h")  # the cursor
    terminal.wait_for("\x1b[?1049l")  # the screen before
    terminal.wait_for("yawid: said meanwhile")
    terminal.wait_for("VERDICT")
    session.join(60.0)


def test_before_the_first_manoeuvre_the_screen_has_no_verdict_and_no_advice_for_logs(
    tmp_path: Path, terminal: Terminal, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a rudder that rests a replay says that another log is needed; time runs tenfold here."""
    monotonic = time.monotonic
    monkeypatch.setattr(time, "monotonic", lambda: 10.0 * monotonic())
    port, stop = free_udp_port(), StopFlag()
    options = LiveOptions(f"udpin:127.0.0.1:{port}", seconds=6000.0)
    given = options, RunConfig(), Outputs(tmp_path, "live"), stop, console_for(terminal.stream)
    session = threading.Thread(target=live, args=given, daemon=True)
    session.start()
    try:
        terminal.wait_for("listening on", 600.0)
        send(frames(20.0, doublet_s=99.0), port)
        terminal.wait_for("RECORDING", 600.0)
        terminal.wait_for(" 2 min ", 600.0)  # the run's time: the stream was judged meanwhile
        shown = terminal.all.decode()
    finally:
        stop.is_set = True
        session.join(60.0)
    assert "VERDICT" in shown
    assert "not known yet" in shown
    for said in ("NOT USABLE", "not_excited", "next:", "replay", "log"):
        assert said not in shown


def test_a_manoeuvre_has_one_answer_on_the_screen(tmp_path: Path, terminal: Terminal) -> None:
    """An aircraft of two pairs of poles, for which the flight chooses other orders: 4.0 is true."""
    pairs = [
        np.poly(np.roots([1.0, 2.0 * z * w, w * w])) for w, z in ((4, 0.2), (8, 0.3), (9.2, 0.3))
    ]
    plant = np.polymul([0.9, 1.0], pairs[2]), np.polymul(pairs[0], pairs[1])
    b, a, _ = cont2discrete(plant, 0.05, method="zoh")
    moves = [1, -1, 0, 0, 0, 1, -1, -1, 1, 0, 0, 0, 0, 1, 1, -1, -1, 0, 0, 0, 1, -1, 0, 0, 1, -1]
    rudder = np.concatenate([np.zeros(160), 0.3 * np.repeat(moves, 8), np.zeros(400)])
    rate = lfilter(b[0], a, rudder)
    rate *= 0.3 / np.abs(rate).max()
    rate += 0.001 * np.random.default_rng(1).standard_normal(len(rate))
    port, stop = free_udp_port(), StopFlag()
    options = LiveOptions(f"udpin:127.0.0.1:{port}", seconds=600.0)
    given = options, RunConfig(), Outputs(tmp_path, "live"), stop, console_for(terminal.stream)
    session = threading.Thread(target=live, args=given, daemon=True)
    session.start()
    try:
        terminal.wait_for("listening on")
        send(frames(len(rate) / 20, hz=20, flown=(rudder, rate)), port)
        terminal.wait_for("FLIGHT")
        terminal.wait_for("STREAM")
        shown = terminal.all.decode()
    finally:
        stop.is_set = True
        session.join(60.0)
    # the stream's own number is shown where the answer is late: it is none
    answers = re.sub(r"running, not judged: wn [0-9.]+ ± [0-9.]+", "", shown)
    found = {float(wn) for wn in re.findall(r"\b([34]\.\d+) ?± ?0\.\d", answers)}
    assert found  # in the table, in the messages and of the flight, with other digits
    assert max(found) - min(found) < 0.02


@pytest.mark.parametrize("why", ["no terminal", "dumb", "small"])
def test_there_are_lines_where_no_screen_can_be_drawn(
    why: str, terminal: Terminal, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert console_for(terminal.stream).draws
    if why == "dumb":
        monkeypatch.setenv("TERM", "dumb")
    if why == "small":
        terminal.resize(10)
    stream = io.StringIO() if why == "no terminal" else terminal.stream
    assert not console_for(stream).draws
