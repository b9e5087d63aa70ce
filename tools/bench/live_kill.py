"""Kills a live session with kill -9 at a given moment, and measures what its files lack."""

from __future__ import annotations

import socket
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from checks.children import LEAVE_S, child
from flights.surgery import Record, split
from mcap.reader import make_reader

from yawid.estimation.machine.runner import RUNNER
from yawid.runs.outputs import Outputs
from yawid.runs.replay import StopFlag, replay
from yawid.sinks.mcap.recover import recover

Row = tuple[str, int, bytes]


@dataclass(frozen=True, slots=True)
class Loss:
    """What a kill cost: the seconds missing at the end of each file, and whether the rest is right.

    ``is_same`` is whether every row of the recovered MCAP equals, bit for bit, one of a replay of
    the tlog. ``frames`` and ``rows`` are how many the two files have.
    """

    tlog_s: float
    mcap_s: float
    frames: int
    rows: int
    is_same: bool


class Sender(threading.Thread):
    """Sends frames at ``speed`` times the pace of their stamps; notes the time of each in s."""

    def __init__(self, frames: Sequence[Record], port: int, speed: float) -> None:
        super().__init__(daemon=True)
        self.sent_s: list[float] = []
        self._frames, self._port, self._speed = frames, port, speed
        self._stop_asked = threading.Event()

    def run(self) -> None:
        """Send the frames until :meth:`stop` is called."""
        start_s, first_us = time.monotonic(), self._frames[0][0]
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
            for stamp_us, frame in self._frames:
                due_s = start_s + (stamp_us - first_us) / 1e6 / self._speed
                if self._stop_asked.wait(max(0.0, due_s - time.monotonic())):
                    return
                sock.sendto(frame, ("127.0.0.1", self._port))
                self.sent_s.append(time.time())

    def stop(self) -> None:
        """Stop sending, and wait for the end of the thread."""
        self._stop_asked.set()
        self.join(LEAVE_S)


def kill_once(frames: Sequence[Record], moment_s: float, folder: Path, speed: float = 1.0) -> Loss:
    """Start a session, send frames, and kill it ``moment_s`` after the first; return the loss."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    command = [
        sys.executable,
        "-m",
        "yawid",
        "live",
        f"udpin:127.0.0.1:{port}",
        "--out",
        str(folder),
    ]
    if not RUNNER.is_compiled():  # a compiler would still be at work when the session is killed
        RUNNER.compile()
    with child(command, stderr=subprocess.PIPE) as process:
        assert process.stderr is not None
        assert b"listening" in process.stderr.readline()
        sender = Sender(frames, port, speed)
        sender.start()
        time.sleep(moment_s)
        killed_s = time.time()
        process.kill()
        sender.stop()
    return measure(folder, sender.sent_s, killed_s)


def measure(folder: Path, sent_s: Sequence[float], killed_s: float) -> Loss:
    """Replay the incomplete tlog, recover the incomplete MCAP, and compare them."""
    [tlog], [mcap] = folder.glob("*.tlog.part"), folder.glob("*.mcap.part")
    frames = len(split(tlog.read_bytes()))
    recover(mcap, folder / "recovered.mcap")
    replay(tlog, {}, Outputs(folder, "again"), StopFlag())
    rescued, again = rows(folder / "recovered.mcap"), rows(folder / "again.mcap")
    missing_s = killed_s - sent_s[frames] if frames < len(sent_s) else 0.0
    last_s = max((received for _, received, _ in rescued), default=0) / 1e9
    # Rows from before the kill that the replay of the tlog has, and the recovered file lacks.
    unwritten = [r / 1e9 for _, r, _ in again if last_s < r / 1e9 <= killed_s]
    return Loss(
        tlog_s=max(0.0, missing_s),
        mcap_s=killed_s - min(unwritten) if unwritten else 0.0,
        frames=frames,
        rows=len(rescued),
        is_same=set(rescued) <= set(again),
    )


def rows(path: Path) -> list[Row]:
    """Return (topic, receive stamp in ns, message) of each message in the order of the file.

    The verdict and the run's log messages are left out.
    """
    with path.open("rb") as stream:
        return [
            (channel.topic, message.publish_time, message.data)
            for _, channel, message in make_reader(stream).iter_messages()
            if channel.topic not in ("/yawid/verdict", "/yawid/log")
        ]
