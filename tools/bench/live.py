"""The live tap: loss and CPU per message, latency, kill -9, a soak at 50 times the speed.

The parts are independent: --only loss latency kill soak. ``--seconds`` is the length of the loss at
20 000 messages a second, ``--soak`` that of the soak. The sender is a process of its own.
"""

from __future__ import annotations

import argparse
import itertools
import json
import math
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
from checks.children import LEAVE_S, LONG_S, child, free_udp_port, resident_mb
from flights.long_log import write_log
from flights.surgery import Record, split
from flights.telemetry import send
from mcap.records import Metadata

from bench.frame import head, line, options_of
from yawid.channels.stage import WANTED
from yawid.estimation.machine.runner import RUNNER
from yawid.runs.outputs import Outputs
from yawid.runs.replay import replay
from yawid.runs.stop import StopFlag
from yawid.sinks.mcap.records import intact
from yawid.sources.link.endpoints import Endpoint
from yawid.sources.link.udp import UdpTap
from yawid.sources.mavlink.decoder import Decoder

LOG = Path(__file__).resolve().parents[2] / "replay_logs" / "sitl_fbwa_50hz" / "log.tlog"
QUIET_S = 0.5
ENDING_S = 300.0
"""Time limit in s for the end of a session, which estimates each of its vehicles then."""
SOAK_SPEED, HOUR_S, WARM_S = 50.0, 3600.0, 60.0


def sent(log: Path, port: int, rate: float = 0.0, count: int = 0) -> None:
    """Send the frames of a log to a port on loopback, or ``count`` at ``rate`` a second."""
    records: Iterable[Record] = split(log.read_bytes())
    if rate:
        frames = zip(range(count), itertools.cycle(records), strict=False)
        records = ((round(1e6 * i / rate), frame) for i, (_, frame) in frames)
    send(records, ("127.0.0.1", port))


def vehicle(*arguments: object) -> Any:
    """Start a process that sends as :func:`sent` does."""
    process = get_context("spawn").Process(target=sent, args=arguments, daemon=True)
    process.start()
    return process


@contextmanager
def session(folder: Path) -> Iterator[tuple[subprocess.Popen[str], int]]:
    """Start ``yawid live`` on a free port; yield the process and the port once it listens."""
    port = free_udp_port()
    command = ["-m", "yawid", "live", f"udpin:127.0.0.1:{port}", "--out", str(folder), "--json"]
    pipe = subprocess.PIPE
    with child([sys.executable, *command], LONG_S, stdout=pipe, stderr=pipe, text=True) as process:
        assert process.stderr is not None
        assert "listening" in process.stderr.readline()
        yield process, port


def of_loss(options: argparse.Namespace) -> Iterator[str]:
    """Receive and decode 20 000 messages a second, then 80 000; count what is lost."""
    for rate, seconds in ((20_000, options.seconds), (80_000, options.seconds / 3)):
        count = int(rate * seconds)
        with UdpTap(Endpoint("127.0.0.1", 0)) as tap:
            decoder, cpu_s = Decoder(WANTED), time.process_time()
            process, heard_s = vehicle(options.log, tap.address[1], rate, count), time.monotonic()
            while process.is_alive() or time.monotonic() - heard_s < QUIET_S:
                if data := tap.read(0.2):
                    heard_s = time.monotonic()
                    decoder.feed(data)
            cpu_us = 1e6 * (time.process_time() - cpu_s) / max(tap.inbox.received, 1)
            lost = count - tap.inbox.received
            yield f"{rate} msg/s for {seconds:g} s: {lost} of {count} lost, {cpu_us:.1f} us each"


def of_latency(options: argparse.Namespace) -> Iterator[str]:
    """Measure the latency of the whole program at a 50 Hz mix."""
    with tempfile.TemporaryDirectory() as name, session(Path(name)) as (process, port):
        vehicle(options.log, port).join(LONG_S)
        process.terminate()
        summary = json.loads(process.communicate(timeout=ENDING_S)[0])
    shown = ", ".join(f"{name} {ms:g}" for name, ms in summary["live"]["latency_ms"].items())
    yield f"last frame of a sample to its estimate {shown} ms"


def of_kill(options: argparse.Namespace) -> Iterator[str]:
    """Kill a session with kill -9 at random moments, and measure what is lost."""
    frames = split(options.log.read_bytes())
    losses = []
    for moment_s in np.random.default_rng(0).uniform(7.0, 15.0, options.kills).tolist():
        with tempfile.TemporaryDirectory() as folder:
            losses.append(kill_once(frames, moment_s, Path(folder)))
    yield (
        f"kill -9, {len(losses)} times: at most {max(x.tlog_s for x in losses):.2f} s of the tlog "
        f"and {max(x.mcap_s for x in losses):.2f} s of the MCAP missing; "
        f"{sum(x.is_same for x in losses)} times the rows left are a replay's"
    )


def hours(seconds: float) -> Iterator[Record]:
    """Yield what a vehicle sends in ``seconds`` of its time: an hour of telemetry again and again.

    Each time it has booted again. It is silent for 20 s every ten minutes, and for one second in
    every 97.
    """
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "hour.tlog"
        write_log(path, min(seconds / HOUR_S, 1.0), "raised")
        records = split(path.read_bytes())
    first_us = records[0][0]
    for boot in range(math.ceil(seconds / HOUR_S)):
        for stamp_us, frame in records:
            second = (stamp_us - first_us) // 1_000_000
            if second % 600 < 580 and second % 97 != 96:
                yield stamp_us + round(1e6 * HOUR_S) * boot, frame


def of_soak(options: argparse.Namespace) -> Iterator[str]:
    """Send a flight at 50 times its speed, with silences, reboots and gaps; watch the memory."""
    memory: list[tuple[float, float]] = []
    with tempfile.TemporaryDirectory() as name, session(Path(name)) as (process, port):
        assert process.stderr is not None
        threading.Thread(target=process.stderr.read, daemon=True).start()
        to = (hours(SOAK_SPEED * options.soak), ("127.0.0.1", port), SOAK_SPEED)
        flight = threading.Thread(target=send, args=to, daemon=True)
        start_s = time.monotonic()
        flight.start()
        while flight.is_alive():
            flight.join(LEAVE_S)
            memory.append((time.monotonic() - start_s, resident_mb(process.pid)))
        process.terminate()
        assert process.stdout is not None
        summary: dict[str, Any] = json.loads(process.stdout.read())
    warm = [mb for at_s, mb in memory if at_s >= WARM_S] or [memory[-1][1]]
    link = summary["link"]
    yield (
        f"{memory[-1][0]:.0f} s at {SOAK_SPEED:g}x, {link['frames']} frames, "
        f"{sum(summary['live']['dropped'].values())} dropped, {link['reboots']} reboots, "
        f"{link['gaps']} gaps; memory {memory[-1][1]:.0f} MB, "
        f"grown by {max(warm) - warm[0]:.1f} after a minute"
    )


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
    rescued, again = rows(mcap), rows(folder / "again.mcap")
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


def rows(path: Path) -> list[Row]:
    """Return (topic, receive stamp in ns, message) of each message of a file, up to where it ends.

    The verdict and the run's log messages are left out.
    """
    with path.open("rb") as stream:
        parts = [part for part in intact(stream) if not isinstance(part, Metadata)]
    return [
        (channel.topic, message.publish_time, message.data)
        for part in parts
        for _, channel, message in part
        if channel.topic not in ("/yawid/verdict", "/yawid/log")
    ]


PARTS: dict[str, Callable[[argparse.Namespace], Iterator[str]]] = {
    "loss": of_loss, "latency": of_latency, "kill": of_kill, "soak": of_soak,
}  # fmt: skip


def main(arguments: list[str]) -> Iterator[str]:
    """Yield the rows of the parts asked for."""
    own = {"only": tuple(PARTS)[:-1], "log": LOG, "seconds": 60.0, "kills": 20, "soak": 300.0}
    options = options_of("live", __doc__, arguments, **own)
    yield from head("", ("measured on loopback",))
    for part in options.only:
        for found in PARTS[part](options):
            yield line(part, found)
