"""Kills a live session with kill -9 at a given moment, and measures what its files lack."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from checks.children import LEAVE_S
from flights.send_tlog import send
from flights.surgery import Record, split
from mcap.reader import make_reader
from mcap.records import Metadata

from bench.live import session
from yawid.estimation.machine.runner import RUNNER
from yawid.runs.outputs import Outputs
from yawid.runs.replay import replay
from yawid.runs.stop import StopFlag
from yawid.sinks.mcap.records import intact

Row = tuple[str, int, bytes]


@dataclass(frozen=True, slots=True)
class Loss:
    """What a kill cost: the seconds missing at the end of each file, and whether the rest is right.

    ``is_same`` is whether every row of the torn MCAP equals, bit for bit, one of a replay of
    the tlog. ``frames`` and ``rows`` are how many the two files have.
    """

    tlog_s: float
    mcap_s: float
    frames: int
    rows: int
    is_same: bool


def noted(frames: Sequence[Record], sent_s: list[float], stop: threading.Event) -> Iterator[Record]:
    """Yield frames until ``stop`` is set; add to ``sent_s`` when each was sent, in Unix time."""
    for frame in frames:
        if stop.is_set():
            return
        yield frame
        sent_s.append(time.time())


def kill_once(frames: Sequence[Record], moment_s: float, folder: Path, speed: float = 1.0) -> Loss:
    """Start a session, send frames, and kill it ``moment_s`` after the first; return the loss."""
    if not RUNNER.is_compiled():  # a compiler would still be at work when the session is killed
        RUNNER.compile()
    sent_s: list[float] = []
    stop = threading.Event()
    with session(folder) as (process, port):
        to = (noted(frames, sent_s, stop), ("127.0.0.1", port), speed)
        sender = threading.Thread(target=send, args=to, daemon=True)
        sender.start()
        time.sleep(moment_s)
        killed_s = time.time()
        process.kill()
        stop.set()
        sender.join(LEAVE_S)
    return measure(folder, sent_s, killed_s)


def measure(folder: Path, sent_s: Sequence[float], killed_s: float) -> Loss:
    """Replay the incomplete tlog, read the incomplete MCAP, and compare them."""
    [tlog], [mcap] = folder.glob("*.tlog.part"), folder.glob("*.mcap.part")
    frames = len(split(tlog.read_bytes()))
    replay(tlog, {}, Outputs(folder, "again"), StopFlag())
    rescued, again = rows_left(mcap), rows(folder / "again.mcap")
    missing_s = killed_s - sent_s[frames] if frames < len(sent_s) else 0.0
    last_s = max((received for _, received, _ in rescued), default=0) / 1e9
    # Rows from before the kill that the replay of the tlog has, and the torn file lacks.
    unwritten = [r / 1e9 for _, r, _ in again if last_s < r / 1e9 <= killed_s]
    return Loss(
        tlog_s=max(0.0, missing_s),
        mcap_s=killed_s - min(unwritten) if unwritten else 0.0,
        frames=frames,
        rows=len(rescued),
        is_same=set(rescued) <= set(again),
    )


def rows_left(path: Path) -> list[Row]:
    """Return what :func:`rows` does of a file that was cut off."""
    with path.open("rb") as stream:
        return [
            (channel.topic, message.publish_time, message.data)
            for part in intact(stream)
            if not isinstance(part, Metadata)
            for _, channel, message in part
            if channel.topic not in ("/yawid/verdict", "/yawid/log")
        ]


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
