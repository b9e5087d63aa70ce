"""What a session says while it runs, in lines or on a real terminal; never a stale number."""

from __future__ import annotations

import fcntl
import io
import os
import pty
import re
import select
import socket
import struct
import subprocess
import termios
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from checks.children import LEAVE_S, child, free_udp_port
from flights.surgery import join, split
from live_link import BEAT, Screen, frames, listening, send
from places import REPLAY_LOGS
from scipy.signal import cont2discrete, lfilter

from yawid.channels.stage import WANTED
from yawid.config.run import RunConfig
from yawid.pipeline import Pipeline
from yawid.runs.job import feed_all
from yawid.runs.live import Console, LiveOptions, live
from yawid.runs.live.running_answer import RunningAnswer
from yawid.runs.live.screen_facts import Gatherer
from yawid.runs.outputs import Outputs
from yawid.runs.replay import StopFlag
from yawid.sinks.terminal.console import console_for
from yawid.sinks.terminal.live_page import what_to_do
from yawid.sources.logs.tlog import TlogReader
from yawid.sources.mavlink.decoder import Decoder

NUMBER = re.compile(r"\bwn -?\d")


def test_the_line_says_what_comes_a_silent_vehicle_and_at_the_end_all_that_waited_is_recorded(
    tmp_path: Path,
) -> None:
    sent, last, beats = frames(20.0), frames(3.0, first_s=130.0), 0
    only_mcap = Outputs(tmp_path, "live", record=False)
    with (
        listening(tmp_path, outputs=only_mcap) as session,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link,
    ):
        session.screen.wait_for("lost 0, dropped 0, waiting for rudder and yaw rate")
        send(sent[:300] + sent[320:], session.port, link)
        session.screen.wait_for("tracking, ")
        patience = time.monotonic() + 60.0
        while not session.lines("yawid: no sample for"):  # next to its ground station
            assert time.monotonic() < patience
            send([BEAT], session.port, link)
            beats += 1
            time.sleep(0.1)
        send(last, session.port, link)
    line = session.lines("tracking")[0]
    for word in ("msg/s", "lost 20, dropped 0", "samples", "wn", "zeta"):
        assert word in line
    assert not [text for text in session.lines("no sample") if "tracking" in text]
    assert not session.lines("nothing received")
    assert session.ended[0].summary.link.frames == len(sent) - 20 + beats + len(last)
    assert [path.name for path in tmp_path.iterdir()] == ["live.mcap"]


def test_a_dead_link_is_said_at_once_with_its_time_and_once_and_so_is_its_return(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("yawid.runs.live.loop.SILENT_US", 1_000_000)
    # A line every ten minutes: what is said is said because the samples have stopped.
    with listening(tmp_path, line_s=600.0) as session:
        send(frames(20.0), session.port)
        session.screen.wait_for("yawid: nothing received for")
        assert not session.lines("tracking")
        send(frames(10.0, first_s=120.0), session.port)
        session.screen.wait_for("598 samples")
    assert len(session.lines("nothing received for")) == 2
    said = session.screen.getvalue()
    assert 1 <= said.count("the link is back") <= said.count("no data for 1 s") <= 2


def test_of_a_flight_that_cannot_answer_the_line_says_no_number(tmp_path: Path) -> None:
    """An AUTO mission of ArduPlane, in which the rudder follows the aileron: 10.06 is true."""
    flown = [f for _, f in split((REPLAY_LOGS / "sitl_auto" / "log.tlog").read_bytes())]
    with listening(tmp_path, RunConfig(), line_s=0.02) as session:
        session.fly(flown[:6000])

    assert not session.ended[0].summary.deciding.usable
    assert [line for line in session.lines(" samples") if NUMBER.search(line)] == []
    assert len(session.lines("running: not known yet")) > 3


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
            self.read()
        self.written = self.written[self.written.index(text.encode()) :]

    def read(self) -> None:
        """Take what is written within a tenth of a second."""
        if select.select([self._master], [], [], 0.1)[0]:
            read = os.read(self._master, 65536)
            self.written, self.all = self.written + read, self.all + read

    def close(self) -> None:
        self.stream.close()
        os.close(self._master)


@pytest.fixture
def terminal(monkeypatch: pytest.MonkeyPatch) -> Iterator[Terminal]:
    monkeypatch.setenv("TERM", "xterm-256color")
    opened = Terminal()
    yield opened
    opened.close()


@contextmanager
def on_screen(
    terminal: Terminal, folder: Path, within_s: float = 60.0
) -> Iterator[tuple[int, Any]]:
    """Run a session on a terminal; yield its port and console."""
    port, stop = free_udp_port(), StopFlag()
    options = LiveOptions(f"udpin:127.0.0.1:{port}", seconds=6000.0)
    console = console_for(terminal.stream)
    given = options, RunConfig(), Outputs(folder, "live"), stop, console
    session = threading.Thread(target=live, args=given, daemon=True)
    session.start()
    try:
        terminal.wait_for("listening on", within_s)
        yield port, console
    finally:
        stop.is_set = True
        session.join(60.0)


def test_before_the_first_manoeuvre_the_screen_has_no_verdict_and_no_advice_for_logs(
    tmp_path: Path, terminal: Terminal, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a rudder that rests a replay says that another log is needed; time runs fortyfold here."""
    monotonic = time.monotonic
    monkeypatch.setattr(time, "monotonic", lambda: 40.0 * monotonic())
    with on_screen(terminal, tmp_path, 2400.0) as (port, _):
        send(frames(20.0, doublet_s=99.0), port)
        terminal.wait_for("RECORDING", 2400.0)
        late_s = time.monotonic() + 2400.0
        while not re.search(rb" ([2-9]|\d\d) min ", terminal.all):
            assert time.monotonic() < late_s, "the run's time, in which the stream is judged"
            terminal.read()
        shown = terminal.all.decode()
    assert "VERDICT" in shown
    assert "not known yet" in shown
    for said in ("NOT USABLE", "not_excited", "next:", "replay", "log"):
        assert said not in shown


def recorded(name: str) -> bytes:
    return (REPLAY_LOGS / name / "log.tlog").read_bytes()


SLOW = join((1_700_000_000_000_000 + 125_000 * i, each) for i, each in enumerate(frames(40, hz=4)))


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (lambda: SLOW, "ask for attitude and servo outputs at 25 Hz (streamrate 25)"),
        (lambda: recorded("turns_gusts"), "doublet, 10 % of half travel or more; then hands off"),
        (lambda: recorded("c172p_damped"), "for the bare airframe: switch the yaw damper off"),
        (lambda: recorded("c172p_gcs_rates"), "for the bare airframe: attitude and servo outputs"),
        (lambda: recorded("c172p_mavlink1"), "for the bare airframe: a doublet, then one of the a"),
    ],
)
def test_next_is_what_is_missing_as_flown_then_for_the_airframe_and_never_about_a_log(
    data: Callable[[], bytes], said: str
) -> None:
    decoder, pipeline = Decoder(WANTED), Pipeline(RunConfig(lateral="off", ordinary="off"))
    feed_all(TlogReader([data()], decoder), pipeline)
    answer = RunningAnswer().look(pipeline, decoder.link)

    step = what_to_do(Gatherer().facts(pipeline, decoder.link, "", answer))

    assert step.text.startswith(said)


def test_a_manoeuvre_has_one_answer_on_the_screen_a_dead_link_is_said_and_the_terminal_left_clean(
    tmp_path: Path, terminal: Terminal
) -> None:
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
    with on_screen(terminal, tmp_path) as (port, console):
        send(frames(len(rate) / 20, hz=20, flown=(rudder, rate)), port)
        terminal.wait_for("FLIGHT")
        terminal.wait_for("STREAM")
        terminal.wait_for("NOTHING RECEIVED FOR")  # long before the session's end
        shown = terminal.all.decode()
        console.say("said meanwhile")
    terminal.wait_for("\x1b[?25h")  # the cursor
    terminal.wait_for("\x1b[?1049l")  # the screen before
    terminal.wait_for("yawid: said meanwhile")
    terminal.wait_for("VERDICT")
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


def test_a_line_that_updates_is_cleared_for_one_that_stays_and_threads_write_whole_lines() -> None:
    screen = Screen()
    screen.isatty = lambda: True  # type: ignore[method-assign] # a terminal, once
    console = Console(screen)
    console.show("12 msg/s, 3 samples")
    other = threading.Thread(target=console.say, args=("the link is back",), daemon=True)
    other.start()
    other.join(60.0)
    console.close()

    assert screen.getvalue().endswith("\r\x1b[2Kyawid: the link is back\n12 msg/s, 3 samples\n")


def test_a_terminal_that_hangs_keeps_nobody_waiting_and_one_that_was_closed_ends_nothing() -> None:
    with child(["true"], stdin=subprocess.PIPE, text=True) as gone:
        gone.wait(LEAVE_S)
        console = Console(gone.stdin)
        console.say("still flying")
        console.show("12 msg/s")
    reader, writer = os.pipe()
    with open(writer, "w", encoding="utf-8") as stream:  # noqa: PTH123 # a pipe has no path
        console = Console(stream)
        begun_s = time.monotonic()
        for _ in range(100):
            console.say(1000 * "x")  # more than a pipe holds, and nobody reads
        assert time.monotonic() - begun_s < 30.0  # or for ever
        said = b""
        while len(said) < 100 * len(f"yawid: {1000 * 'x'}\n"):
            said += os.read(reader, 1 << 16)
        console.close()
    os.close(reader)
