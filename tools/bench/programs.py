"""Benches of the program in processes of its own: its start, a live session, a fleet.

python tools/bench.py start [--rounds 5]
python tools/bench.py live [--soak]
python tools/bench.py fleet [--count 2000] [--workers 2]
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from argparse import Namespace
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from itertools import cycle, islice, product, takewhile
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import psutil
from checks.children import LEAVE_S, LONG_S, child, cost_of, free_udp_port, resident_mb
from flights.long_log import START_US, write_log
from flights.surgery import Record, split
from flights.telemetry import send
from mcap.records import Metadata

from bench.frame import NOT_MET, ROOT, best, table
from yawid.channels.stage import WANTED
from yawid.dataset.files import read_table
from yawid.estimation.machine.runner import RUNNER
from yawid.runs.outputs import Outputs
from yawid.runs.replay import replay
from yawid.runs.stop import StopFlag
from yawid.sinks.mcap.records import intact
from yawid.sources.link.endpoints import Endpoint
from yawid.sources.link.udp import UdpTap
from yawid.sources.mavlink.decoder import Decoder

LOGS = ROOT / "replay_logs"
SHORT_LOG, LIVE_LOG = LOGS / "c172p_3211" / "log.tlog", LOGS / "sitl_fbwa_50hz" / "log.tlog"
NUMPY, SHORT, WALL, COLD = "`import numpy`", "a replay", "its wall", "cold, wall"
HOURS = {"an hour": "off", "manoeuvres": "auto"}
MOST = {(SHORT, NUMPY): 8.0, (COLD, WALL): 2.0}
"""Limits: the CPU of a replay over that of importing NumPy, and a cold replay over a warm one."""
MOVED_S, EVERY_S = 30.0, 300.0
"""The long logs have a manoeuvre of MOVED_S seconds in every EVERY_S seconds."""


def replayed(
    log: Path, folder: Path, manoeuvres: str = "auto", of: str = "cpu_s", code: str = "code"
) -> float:
    """Return what a replay in a process of its own costs, which keeps compiled code in ``code``."""
    to = ["--out", str(folder), "--force", "--json", "--rerun", "off", "--manoeuvres", manoeuvres]
    environment = os.environ | {"NUMBA_CACHE_DIR": str(folder / code)}
    answered = (0, 5)  # a usable answer or none
    cost = cost_of("-m", "yawid", "replay", str(log), *to, allowed=answered, env=environment)
    return float(getattr(cost, of))


def start(options: Namespace) -> Iterator[str]:
    """Measure the cost of short runs: start-up, compiling, and what one more hour of log adds.

    Each of these runs in a process of its own: the import of NumPy alone; ``yawid --help``; a
    replay of half a minute with compiled code; the same with an empty folder for compiled code. "An
    hour" is how much longer a replay takes for one more hour of log (20 Hz, to MCAP), without and
    with its manoeuvres. Seconds are CPU time with that of children, or wall time where the column
    says so, and are the least of all rounds; the ratio in brackets is to the import of NumPy.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for hours in (1, 2):
            path = folder / f"{hours}.tlog"
            write_log(path, hours, "raised", moved_s=MOVED_S, every_s=EVERY_S)
        replayed(SHORT_LOG, folder)  # compiles what the later ones find
        short: dict[str, Callable[[], float]] = {
            NUMPY: lambda: cost_of("-c", "import numpy").cpu_s,
            "`yawid --help`": lambda: cost_of("-m", "yawid", "--help").cpu_s,
            SHORT: partial(replayed, SHORT_LOG, folder),
            WALL: partial(replayed, SHORT_LOG, folder, of="wall_s"),
            COLD: lambda: replayed(
                SHORT_LOG, folder, of="wall_s", code=tempfile.mkdtemp(dir=folder)
            ),
        }
        long = {f"{column} {n}": partial(replayed, folder / f"{n}.tlog", folder, setting)
                for (column, setting), n in product(HOURS.items(), (1, 2))}  # fmt: skip
        least = best(short | long, options.rounds)
    added = {column: least[f"{column} 2"] - least[f"{column} 1"] for column in HOURS}
    shown = {name: f"{s:.3g}" if "wall" in name else f"{s:.3g} ({s / least[NUMPY]:.2g})"
             for name, s in (least | added).items() if name not in long}  # fmt: skip
    yield from table("", [("s", shown)])
    yield ""
    for (what, of), most in MOST.items():
        if least[what] > most * least[of]:
            yield f"{NOT_MET}{what}: {least[what] / least[of]:.1f} x {of}; {most:g} is allowed"


LOADS = {20_000: 60, 80_000: 20}
"""How long the loss is measured, in s, by messages a second."""
QUIET_S = 0.5
KILLS, KILLED_S = 20, (7.0, 15.0)
SOAK_SPEED, HOUR_S, WARM = 50, 3600, 5
"""The soak's memory is compared from its value number WARM on, of one every LEAVE_S."""


def send_at(rate: int, count: int, to: tuple[str, int]) -> None:
    """Send frames of the log, again and again, at a rate in messages a second."""
    frames = islice(cycle(frame for _, frame in split(LIVE_LOG.read_bytes())), count)
    send(((round(1e6 * i / rate), frame) for i, frame in enumerate(frames)), to)


def of_loss() -> str:
    """Receive and decode what a process sends at each of LOADS; count what is lost."""
    return "; ".join(loss(rate, seconds) for rate, seconds in LOADS.items())


def loss(rate: int, seconds: int) -> str:
    """Return what is lost of messages at a rate, and the CPU time that each takes."""
    count, decoder = rate * seconds, Decoder(WANTED)
    with UdpTap(Endpoint("127.0.0.1", 0)) as tap:
        to = rate, count, ("127.0.0.1", tap.address[1])
        process = get_context("spawn").Process(target=send_at, args=to, daemon=True)
        process.start()
        cpu_s, heard_s = time.process_time(), time.monotonic()
        while process.is_alive() or time.monotonic() - heard_s < QUIET_S:
            if data := tap.read(0.2):
                heard_s = time.monotonic()
                decoder.feed(data)
    cpu_us = 1e6 * (time.process_time() - cpu_s) / max(tap.inbox.received, 1)
    lost = count - tap.inbox.received
    return f"{rate} msg/s for {seconds} s: {lost} of {count} lost, {cpu_us:.1f} us each"


@contextmanager
def session(
    folder: Path, frames: Iterable[Record], speed: float
) -> Iterator[tuple[subprocess.Popen[str], threading.Thread]]:
    """Start ``yawid live``, and once it listens, to send it frames; yield it and the sender.

    The sender stops with the block.
    """
    port, ended = free_udp_port(), threading.Event()
    command = ["-m", "yawid", "live", f"udpin:127.0.0.1:{port}", "--out", str(folder), "--json"]
    pipe = subprocess.PIPE
    with child([sys.executable, *command], LONG_S, stdout=pipe, stderr=pipe, text=True) as process:
        assert process.stderr is not None
        assert "listening" in process.stderr.readline()
        threading.Thread(target=process.stderr.read, daemon=True).start()
        heard = takewhile(lambda _: not ended.is_set(), frames)
        to = heard, ("127.0.0.1", port), speed
        sender = threading.Thread(target=send, args=to, daemon=True)
        sender.start()
        yield process, sender
        ended.set()
        sender.join(LEAVE_S)


def flown(frames: Iterable[Record], speed: float) -> tuple[dict[str, Any], list[float]]:
    """Return a session's summary, and the MB of memory that it had every LEAVE_S."""
    memory: list[float] = []
    with tempfile.TemporaryDirectory() as folder, session(Path(folder), frames, speed) as running:
        process, sender = running
        while sender.is_alive():
            sender.join(LEAVE_S)
            memory.append(resident_mb(process.pid))
        process.terminate()
        assert process.stdout is not None
        return json.loads(process.stdout.read()), memory


def of_latency() -> str:
    """Measure the latency of the whole program at a 50 Hz mix."""
    summary, _ = flown(split(LIVE_LOG.read_bytes()), 1.0)
    shown = ", ".join(f"{name} {ms:g}" for name, ms in summary["live"]["latency_ms"].items())
    return f"last frame of a sample to its estimate {shown} ms"


def hours() -> Iterator[Record]:
    """Yield SOAK_SPEED times an hour of telemetry, for which the vehicle has booted again.

    It is silent for 20 s every ten minutes, and for one second in every 97.
    """
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "hour.tlog"
        write_log(path, 1.0, "raised")
        records = split(path.read_bytes())
    for boot, (stamp_us, frame) in product(range(SOAK_SPEED), records):
        second = (stamp_us - records[0][0]) // 1_000_000
        if second % 600 < 580 and second % 97 != 96:
            yield stamp_us + 1_000_000 * HOUR_S * boot, frame


def of_soak() -> str:
    """Send flights at 50 times their speed, with silences, reboots and gaps; watch the memory."""
    summary, memory = flown(hours(), SOAK_SPEED)
    link, dropped = summary["link"], sum(summary["live"]["dropped"].values())
    return (
        f"{HOUR_S} s at {SOAK_SPEED}x, {link['frames']} frames, {dropped} dropped, "
        f"{link['reboots']} reboots, {link['gaps']} gaps; memory {memory[-1]:.0f} MB, "
        f"grown by {max(memory[WARM:]) - memory[WARM]:.1f} after a minute"
    )


def kill_once(
    frames: Iterable[Record], moment_s: float, folder: Path, speed: float = 1.0
) -> dict[str, float]:
    """Start a session, send frames, and kill it ``moment_s`` after the first; return the loss.

    ``tlog_s`` is the time from the last frame recorded to the kill; ``mcap_s`` that from the first
    row of a replay of the tlog which the torn MCAP lacks. ``frames`` and ``rows`` are how many the
    files have; ``same`` is whether each row equals, bit for bit, one of that replay.
    """
    if not RUNNER.is_compiled():  # a compiler would still be at work when the session is killed
        RUNNER.compile()
    with session(folder, frames, speed) as (process, _):
        time.sleep(moment_s)
        killed_s = time.time()
        process.kill()
    [tlog], [mcap] = folder.glob("*.tlog.part"), folder.glob("*.mcap.part")
    left = split(tlog.read_bytes())
    replay(tlog, {}, Outputs(folder, "again"), StopFlag())
    rescued, again = rows(mcap), rows(folder / "again.mcap")
    last_s = max((received_s for _, received_s, _ in rescued), default=0.0)
    unwritten = [received_s for _, received_s, _ in again if last_s < received_s <= killed_s]
    return {
        "tlog_s": killed_s - left[-1][0] / 1e6,
        "mcap_s": killed_s - min(unwritten, default=killed_s),
        "frames": len(left), "rows": len(rescued), "same": set(rescued) <= set(again),
    }  # fmt: skip


def rows(path: Path) -> list[tuple[str, float, bytes]]:
    """Return topic, receive stamp in s and bytes of each message of a file, up to where it ends.

    The verdict and the run's log messages are left out.
    """
    with path.open("rb") as stream:
        parts = [part for part in intact(stream) if not isinstance(part, Metadata)]
    return [
        (channel.topic, message.publish_time / 1e9, message.data)
        for part in parts
        for _, channel, message in part
        if channel.topic not in ("/yawid/verdict", "/yawid/log")
    ]


def of_kill() -> str:
    """Kill a session with kill -9 at random moments, and measure what is lost."""
    frames, losses = split(LIVE_LOG.read_bytes()), []
    for moment_s in np.random.default_rng(0).uniform(*KILLED_S, KILLS).tolist():
        with tempfile.TemporaryDirectory() as folder:
            losses.append(kill_once(frames, moment_s, Path(folder)))
    worst = {name: max(loss[name] for loss in losses) for name in ("tlog_s", "mcap_s")}
    return (
        f"kill -9, {KILLS} times: at most {worst['tlog_s']:.2f} s of the tlog and "
        f"{worst['mcap_s']:.2f} s of the MCAP missing; "
        f"{sum(loss['same'] for loss in losses):.0f} times the rows left are a replay's"
    )


def live(options: Namespace) -> Iterator[str]:
    """Measure the live tap: loss and CPU per message, latency, and what kill -9 costs.

    With --soak there is the soak, too: 50 hours of telemetry within an hour.
    """
    parts = {"loss": of_loss, "latency": of_latency, "kill": of_kill, "soak": of_soak}
    yield from table("", ((name, {"measured on loopback": part()}) for name, part in parts.items()
                          if name != "soak" or options.soak))  # fmt: skip


LOOK_S, KILL_EVERY_S = 0.5, 30.0
MINUTES, DAY_US = (1.0, 4.0), 86_400 * 10**6


def kill(ended: threading.Event, memory_mb: list[float], killed: list[int]) -> None:
    """Kill a process that replays every KILL_EVERY_S; note the memory of all every LOOK_S."""
    next_s = time.monotonic() + KILL_EVERY_S
    while not ended.wait(LOOK_S):
        with suppress(psutil.Error):  # one has ended, or is just starting again
            every = psutil.Process().children(recursive=True)
            workers = [each for each in every if "yawid.fleet.one_log" in each.cmdline()]
            memory_mb += [each.memory_info().rss / 1e6 for each in workers]
            if workers and time.monotonic() > next_s:
                next_s += KILL_EVERY_S
                workers[len(killed) % len(workers)].kill()
                killed.append(len(killed))


def make(folder: Path, count: int) -> None:
    """Write ``count`` logs of MINUTES each."""
    folder.mkdir()
    rng = np.random.default_rng(1)
    for i in range(count):
        every_s, hours = rng.uniform(60.0, 180.0), rng.uniform(*MINUTES) / 60.0
        start_us = START_US + DAY_US * i
        write_log(folder / f"{i:04d}.tlog", hours, "raised", i, 8.0, every_s, start_us=start_us)


def faults(folder: Path, out: Path) -> list[str]:
    """Return in words how a data set differs from one row for each log, with all of its flights."""
    flown = Counter(read_table(out, "flights")["log_sha256"].to_pylist())
    found = Counter(
        (row["path"], row["outcome"], row["flights"] - flown[row["log_sha256"]])
        for row in read_table(out, "logs").to_pylist()
    )
    found.subtract((str(path.absolute()), "ok", 0) for path in folder.glob("*.tlog"))
    by_count = sorted(found.items(), key=lambda each: each[1])
    # Of a log with another outcome there is one row too many, which counts, and one too few.
    wrong = {path: f"{path}: {outcome}, {missing} flights missing, {count:+d} row"
             for (path, outcome, missing), count in by_count if count}  # fmt: skip
    return list(wrong.values())


def fleet(options: Namespace) -> Iterator[str]:
    """Run ``yawid fleet`` on many logs: each must have one row and an answer, whatever is killed.

    The logs are of 1 to 4 minutes, a day apart. They are run while every KILL_EVERY_S one process
    that replays is killed with -9; then they are run again, which must change no file. The CPU time
    is that of the whole run.
    """
    ended, memory_mb, killed = threading.Event(), [0.0], list[int]()
    with tempfile.TemporaryDirectory() as name:
        logs, out = Path(name) / "logs", Path(name) / "out"
        make(logs, options.count)
        command = ["-m", "yawid", "fleet", str(logs), "--out", str(out)]
        command += ["--workers", str(options.workers)]
        threading.Thread(target=kill, args=(ended, memory_mb, killed), daemon=True).start()
        cost = cost_of(*command)
        ended.set()
        files = {path: path.stat().st_mtime_ns for path in out.rglob("*.parquet")}
        again, wrong = cost_of(*command), faults(logs, out)
        if files != {path: path.stat().st_mtime_ns for path in out.rglob("*.parquet")}:
            wrong.append("the second run changed files")
    yield from table("", [("all", {
        "logs": options.count, "s": f"{cost.wall_s:.0f}", "kills": len(killed),
        "CPU s a log": f"{cost.cpu_s / options.count:.2f}",
        "MB a worker": f"{max(memory_mb):.0f}", "again, s": f"{again.wall_s:.1f}",
        "wrong": len(wrong),
    })])  # fmt: skip
    yield ""
    yield from (f"{NOT_MET}{each}" for each in wrong)
