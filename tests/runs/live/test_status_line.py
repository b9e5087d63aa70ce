"""What a session says while it runs: whole lines, and never that a dead link is tracked."""

from __future__ import annotations

import io
import os
import socket
import threading
import time
from pathlib import Path

from live_link import Screen, frames, listening, send
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from yawid.runs.live import Console


class Terminal(io.StringIO):
    """Takes its time over every write, and notices two at once."""

    def __init__(self) -> None:
        super().__init__()
        self.writing = self.most = 0
        self.second = threading.Event()

    def isatty(self) -> bool:
        return True

    def write(self, text: str) -> int:
        self.writing += 1
        self.most = max(self.most, self.writing)
        if self.writing > 1:
            self.second.set()
        self.second.wait(0.2)
        self.writing -= 1
        return super().write(text)


def test_two_threads_write_one_whole_line_after_the_other():
    terminal = Terminal()
    console = Console(terminal)
    console.show("12 msg/s")
    viewer = threading.Thread(target=console.say, args=("the Rerun viewer is back",), daemon=True)
    viewer.start()
    console.show("13 msg/s")
    viewer.join(60.0)
    console.close()
    assert terminal.getvalue().count("msg/s") >= 2
    assert terminal.most == 1


def test_a_line_that_updates_is_cleared_for_one_that_stays():
    screen = Screen()
    screen.isatty = lambda: True  # type: ignore[method-assign] # a terminal, once
    console = Console(screen)
    console.show("12 msg/s, 3 samples")
    console.say("the link is back")
    console.close()

    assert screen.getvalue().endswith("\r\x1b[2Kyawid: the link is back\n12 msg/s, 3 samples\n")


def test_a_terminal_that_hangs_keeps_nobody_waiting():
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


def last_line(screen: Screen) -> str:
    return screen.getvalue().splitlines()[-1]


def test_a_dead_link_is_said_at_once_with_its_time_and_is_no_longer_tracking(tmp_path: Path):
    # A line every ten minutes: what is said is said because the samples have stopped.
    with listening(tmp_path, line_s=600.0) as session:
        send(frames(20.0), session.port)
        session.screen.wait_for("yawid: nothing received for")
        assert "tracking" not in session.screen.getvalue()
        send(frames(10.0, first_s=120.0), session.port)
        session.screen.wait_for("598 samples")
    assert session.screen.getvalue().count("nothing received for") == 2


def test_a_vehicle_that_falls_silent_beside_its_ground_station_is_not_tracking(tmp_path: Path):
    ground = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
    beat = bytes(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3).pack(ground))
    with (
        listening(tmp_path) as session,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link,
    ):
        send(frames(20.0), session.port, link)
        session.screen.wait_for("tracking")
        patience = time.monotonic() + 60.0
        while "yawid: no sample for" not in session.screen.getvalue():
            assert time.monotonic() < patience, last_line(session.screen)
            send([beat], session.port, link)
            time.sleep(0.1)
    said = session.screen.getvalue()
    assert not [text for text in said.splitlines() if "no sample" in text and "tracking" in text]
    assert "nothing received" not in said


def test_a_link_nobody_has_sent_on_is_waited_for(tmp_path: Path):
    with listening(tmp_path) as session:
        session.screen.wait_for("lost 0, dropped 0, waiting for rudder and yaw rate")
