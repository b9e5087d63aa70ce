"""Benches of the program in processes of its own: its start, a live session, a fleet, its page.

python tools/bench.py start [--rounds 5]
python tools/bench.py live
python tools/bench.py fleet [--count 2000] [--workers 2]
python tools/bench.py serve [--rounds 3] [--count 1000]
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
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import partial
from itertools import cycle, islice, product, takewhile
from multiprocessing import get_context
from pathlib import Path

import httpx
import numpy as np
import psutil
from checks.children import (
    LEAVE_S,
    LONG_S,
    Cost,
    child,
    cost_of,
    flights_page,
    free_udp_port,
)
from flights.long_log import START_US, write_log
from flights.surgery import Record, split
from flights.telemetry import send
from mcap.records import Metadata

from bench.frame import NOT_MET, ROOT, best, table
from bench.speed import MB_AN_HOUR, MEGABYTES
from yawid.channels.stage import WANTED
from yawid.dataset.files import read_table
from yawid.estimation.machine.runner import RUNNER
from yawid.sinks.mcap.records import intact
from yawid.sources.link.endpoints import Endpoint
from yawid.sources.link.udp import UdpTap
from yawid.sources.mavlink.decoder import Decoder

SHORT_LOG, LIVE_LOG = (
    ROOT / "replay_logs" / case / "log.tlog" for case in ("c172p_3211", "sitl_fbwa_50hz")
)
NUMPY, SHORT, WALL, COLD = "`import numpy`", "a replay", "its wall", "cold, wall"
HOURS = {"an hour": "off", "manoeuvres": "auto"}
MOST = {(SHORT, NUMPY): 8.0, (COLD, WALL): 2.0}
"""Limits: the CPU of a replay over that of importing NumPy, and a cold replay over a warm one."""
BARE = dict.fromkeys(("c172p_3211", "sitl_fbwa_50hz"), 1.3)
BARE |= dict.fromkeys(("c172p_three_speeds", "c172p_aileron", "c172p_damper", "sitl_bare"), 1.6)
"""Limits: the CPU of a replay that looks for the bare airframe over one that does not, by case; the
last four have it."""


def replayed(
    log: Path, out: Path, manoeuvres: str = "auto", of: str = "cpu_s", code: str = "",
    lateral: str = "auto",
) -> float:  # fmt: skip
    """Return what a replay in a process of its own costs; ``code`` is a folder for compiled code.

    Without it that is where it always is.
    """
    to = ["--out", str(out), "--force", "--json", "--rerun", "off", "--manoeuvres", manoeuvres]
    to += ["--lateral", lateral]
    own = os.environ | ({"NUMBA_CACHE_DIR": code} if code else {})
    # The exit codes are those of a usable answer and of none.
    cost = cost_of("-m", "yawid", "replay", str(log), *to, allowed=(0, 5), env=own)
    return float(getattr(cost, of))


def start(options: Namespace) -> list[Iterable[str]]:
    """Measure the cost of short runs: start-up, compiling, and what one more hour of log adds.

    Each of these runs in a process of its own: the import of NumPy alone; ``yawid --help``; a
    replay of half a minute with compiled code; the same with an empty folder for compiled code. "An
    hour" is how much longer a replay takes for one more hour of log (20 Hz, to MCAP), without and
    with its manoeuvres, of 30 s in every 300 s. Seconds are CPU time with that of children, or wall
    time where the column says so, and are the least of all rounds; the ratio in brackets is to the
    import of NumPy. The second table has cases replayed with and without the bare airframe.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for hours in (1, 2):
            write_log(folder / f"{hours}.tlog", hours, moved_s=30.0, every_s=300.0)
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
        bare = {f"{case} {setting}": partial(replayed, ROOT / "replay_logs" / case / "log.tlog",
                                             folder, lateral=setting)
                for case, setting in product(BARE, ("off", "auto"))}  # fmt: skip
        least = best(short | long | bare, options.rounds)
    added = {column: least[f"{column} 2"] - least[f"{column} 1"] for column in HOURS}
    shown = {name: f"{s:.3g}" if "wall" in name else f"{s:.3g} ({s / least[NUMPY]:.2g})"
             for name, s in (least | added).items() if name not in long | bare}  # fmt: skip
    pairs = {case: (least[f"{case} off"], least[f"{case} auto"]) for case in BARE}
    limits = MOST | {(f"{case} auto", f"{case} off"): most for case, most in BARE.items()}
    return [table("", {"s": shown}), table("s of CPU", {
        case: {"without": f"{off:.2f}", "with": f"{on:.2f}", "ratio": f"{on / off:.2f}"}
        for case, (off, on) in pairs.items()
    }), (
        f"{NOT_MET}{what}: {least[what] / least[of]:.2f} x {of}; {most:g} is allowed"
        for (what, of), most in limits.items() if least[what] > most * least[of]
    )]  # fmt: skip


LOADS = {20_000: 60, 80_000: 20}
"""How long the loss is measured, in s, by messages a second."""
QUIET_S = 0.5
KILLS, KILLED_S = 20, (7.0, 15.0)


def send_at(rate: int, count: int, to: tuple[str, int]) -> None:
    """Send frames of the log, again and again, at a rate in messages a second."""
    frames = islice(cycle(frame for _, frame in split(LIVE_LOG.read_bytes())), count)
    send(((round(1e6 * i / rate), frame) for i, frame in enumerate(frames)), to)


def of_loss(rate: int, seconds: int) -> str:
    """Receive and decode what a process sends at a rate; count what is lost, and the CPU time."""
    count, decoder = rate * seconds, Decoder(WANTED)
    with UdpTap(Endpoint("127.0.0.1", 0)) as tap:
        to = "127.0.0.1", tap.address[1]
        process = get_context("spawn").Process(target=send_at, args=(rate, count, to), daemon=True)
        process.start()
        cpu_s = time.process_time()
        while (data := tap.read(QUIET_S)) or process.is_alive():
            decoder.feed(data)
    cpu_us = 1e6 * (time.process_time() - cpu_s) / max(tap.inbox.received, 1)
    return (
        f"{rate} msg/s for {seconds} s: {count - tap.inbox.received} of {count} lost, "
        f"{cpu_us:.1f} us each"
    )


@contextmanager
def session(folder: Path) -> Iterator[tuple[subprocess.Popen[str], tuple[str, int]]]:
    """Start ``yawid live``; once it listens, yield it and its address."""
    to, pipe = ("127.0.0.1", free_udp_port()), subprocess.PIPE
    command = ["-m", "yawid", "live", f"udpin:127.0.0.1:{to[1]}", "--out", str(folder), "--json"]
    with child([sys.executable, *command], LONG_S, stdout=pipe, stderr=pipe, text=True) as process:
        assert "listening" in next(iter(process.stderr or ()), "")
        yield process, to


def of_latency() -> str:
    """Measure the latency of the whole program at a 50 Hz mix."""
    with tempfile.TemporaryDirectory() as folder, session(Path(folder)) as (process, to):
        send(split(LIVE_LOG.read_bytes()), to)
        process.terminate()
        found = json.loads(process.communicate(timeout=LEAVE_S)[0])["live"]["latency_ms"]
    return (
        "last frame of a sample to its estimate "
        f"{', '.join(f'{name} {ms:g}' for name, ms in found.items())} ms"
    )


def kill_once(
    frames: Sequence[Record], moment_s: float, folder: Path, speed: float = 1.0
) -> dict[str, float]:
    """Start a session, send frames, and kill it ``moment_s`` after the first; return the loss.

    ``tlog_s`` is the time from the last frame recorded to the kill; ``mcap_s`` that from the first
    row of a replay of the tlog which the torn MCAP lacks. ``frames`` and ``rows`` are how many the
    files have; ``same`` is whether each row equals, bit for bit, one of that replay.
    """
    if not RUNNER.is_compiled():  # a compiler would still be at work when the session is killed
        RUNNER.compile()
    with session(folder) as (process, to):
        begun_s, last_us = time.monotonic(), frames[0][0] + 1e6 * speed * moment_s
        send(takewhile(lambda frame: frame[0] < last_us, frames), to, speed)
        time.sleep(max(begun_s + moment_s - time.monotonic(), 0.0))
        killed_s = time.time()
        process.kill()
    [tlog], [mcap] = folder.glob("*.tlog.part"), folder.glob("*.mcap.part")
    left = split(tlog.read_bytes())
    replayed(tlog, folder / "again")
    rescued, again = rows(mcap), [row for path in folder.glob("again/*.mcap") for row in rows(path)]
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
        return [
            (channel.topic, message.publish_time / 1e9, message.data)
            for part in intact(stream)
            if not isinstance(part, Metadata)
            for _, channel, message in part
            if channel.topic not in ("/yawid/verdict", "/yawid/log")
        ]


def of_kill() -> str:
    """Kill a session with kill -9 at random moments, and measure what is lost."""
    frames, rng = split(LIVE_LOG.read_bytes()), np.random.default_rng(0)
    with tempfile.TemporaryDirectory() as folder:
        losses = [kill_once(frames, moment_s, Path(tempfile.mkdtemp(dir=folder)))
                  for moment_s in rng.uniform(*KILLED_S, KILLS).tolist()]  # fmt: skip
    tlog_s, mcap_s = (max(loss[name] for loss in losses) for name in ("tlog_s", "mcap_s"))
    return (
        f"kill -9, {KILLS} times: at most {tlog_s:.2f} s of the tlog and {mcap_s:.2f} s of the "
        f"MCAP missing; {sum(loss['same'] for loss in losses):.0f} times the rows left are a "
        "replay's"
    )


def live(options: Namespace) -> list[Iterable[str]]:
    """Measure the live tap: loss and CPU per message, latency, and what kill -9 costs."""
    parts = {
        "loss": "; ".join(of_loss(*load) for load in LOADS.items()),
        "latency": of_latency(), "kill": of_kill(),
    }  # fmt: skip
    return [table("", {name: {"measured on loopback": part} for name, part in parts.items()})]


LOOK_S, KILL_EVERY_S = 0.5, 30.0


def kill(ended: threading.Event, memory_mb: list[float], killed_s: list[float]) -> None:
    """Kill a process that replays every KILL_EVERY_S; note the memory of all every LOOK_S.

    ``killed_s`` begins with the time of the start.
    """
    while not ended.wait(LOOK_S):
        with suppress(psutil.Error):  # one has ended, or is just starting again
            workers = [each for each in psutil.Process().children(recursive=True)
                       if "yawid.fleet.one_log" in each.cmdline()]  # fmt: skip
            memory_mb += [each.memory_info().rss / 1e6 for each in workers]
            if workers and time.monotonic() > killed_s[-1] + KILL_EVERY_S:
                workers[len(killed_s) % len(workers)].kill()
                killed_s.append(time.monotonic())


def make(folder: Path, count: int) -> None:
    """Write ``count`` logs of 1 to 4 minutes, a day apart."""
    folder.mkdir()
    rng = np.random.default_rng(1)
    for i in range(count):
        every_s, hours = rng.uniform(60.0, 180.0), rng.uniform(1.0, 4.0) / 60.0
        start_us = START_US + 86_400 * 10**6 * i
        write_log(folder / f"{i:04d}.tlog", hours, i, 8.0, every_s, start_us=start_us)


def faults(folder: Path, out: Path) -> list[str]:
    """Return in words how a data set differs from one row for each log, with all of its flights."""
    flown = Counter(read_table(out, "flights")["log_sha256"].to_pylist())
    found = Counter(
        (row["path"], row["outcome"], row["flights"] - flown[row["log_sha256"]])
        for row in read_table(out, "logs").to_pylist()
    )
    found.subtract((str(path.absolute()), "ok", 0) for path in folder.glob("*.tlog"))
    # Of a log with another outcome there is one row too many, which counts, and one too few.
    return [*{
        path: f"{path}: {outcome}, {missing} flights missing, {many:+d} row"
        for (path, outcome, missing), many in reversed(found.most_common()) if many
    }.values()]  # fmt: skip


def fleet(options: Namespace) -> list[Iterable[str]]:
    """Run ``yawid fleet`` on many logs: each must have one row and an answer, whatever is killed.

    The logs are of 1 to 4 minutes, a day apart. They are run while every KILL_EVERY_S one process
    that replays is killed with -9; then they are run again, which must change no file. The CPU time
    is that of the whole run.
    """
    with tempfile.TemporaryDirectory() as name:
        logs, out = Path(name) / "logs", Path(name) / "out"
        make(logs, options.count)
        ended, memory_mb, killed_s = threading.Event(), [0.0], [time.monotonic()]
        to = ["--out", str(out), "--workers", str(options.workers)]
        threading.Thread(target=kill, args=(ended, memory_mb, killed_s), daemon=True).start()
        cost = cost_of("-m", "yawid", "fleet", str(logs), *to)
        ended.set()
        ended_ns = time.time_ns()
        again, wrong = cost_of("-m", "yawid", "fleet", str(logs), *to), faults(logs, out)
        wrong += [f"the second run wrote {path}" for path in out.rglob("*.parquet")
                  if path.stat().st_mtime_ns > ended_ns]  # fmt: skip
    return [table("", {"all": {
        "logs": options.count, "s": f"{cost.wall_s:.0f}", "kills": len(killed_s) - 1,
        "CPU s a log": f"{cost.cpu_s / options.count:.2f}",
        "MB a worker": f"{max(memory_mb):.0f}", "again, s": f"{again.wall_s:.1f}",
        "wrong": len(wrong),
    }}), (f"{NOT_MET}{each}" for each in wrong)]  # fmt: skip


POLL_S, MOST_TIMES, MOST_LIST_S = 0.2, 1.5, 1.0
"""Limits: the first answer by the page over the command's; the time in s of the whole list."""


def cpu_s(server: int) -> float:
    """Return the CPU time of a process with that of its children, also those that have ended."""
    whole = psutil.Process(server)
    return float(sum(sum(each.cpu_times()[:4]) for each in [whole, *whole.children(True)]))


def dropped(log: Path, address: str, server: int) -> Cost:
    """Drop a log on the page of a process; return what it cost until every log had its answer."""
    start_s, before_s = time.perf_counter(), cpu_s(server)
    httpx.put(f"{address}flights/{log.name}", content=log.read_bytes()).raise_for_status()
    while httpx.get(f"{address}progress").json()["logs"]:
        time.sleep(POLL_S)
    return Cost(time.perf_counter() - start_s, cpu_s(server) - before_s)


def serve(options: Namespace) -> list[Iterable[str]]:
    """Measure a log's answer by the page and by the command, and the list of many flights.

    The log is of 20 MB, with manoeuvres of 30 s in every 300 s. Page and command take turns, and
    the least of all rounds counts; in brackets is its ratio to the command's. The page's CPU time
    is that of the server and its processes. Its folder has ``--count`` logs of 1 to 4 minutes that
    were read before. Their list is asked for after another start, for the second time.
    """
    with tempfile.TemporaryDirectory() as name:
        long, logs = Path(name, "long.tlog"), Path(name, "logs")
        make(logs, options.count)
        write_log(long, MEGABYTES[0] / MB_AN_HOUR, moved_s=30.0, every_s=300.0)
        command = ["-m", "yawid", "replay", str(long), "--out", name, "--force", "--json"]
        with flights_page(logs, LONG_S) as (address, process):
            dropped(SHORT_LOG, address, process.pid)
            turns = [(dropped(long, address, process.pid), cost_of(*command, allowed=(0, 5)))
                     for _ in range(options.rounds)]  # fmt: skip
        with flights_page(logs) as (address, _):
            httpx.get(address)
            start_s = time.perf_counter()
            with httpx.stream("GET", address) as answer:
                first_s = time.perf_counter() - start_s
                usable = answer.read().count(b'"good">usable')
            whole_s = time.perf_counter() - start_s
    page, own = np.min(turns, axis=0)
    found = {f"by the page, {of}": f"{s:.3g} ({times:.2f})"
             for of, s, times in zip(("wall", "CPU"), page, page / own, strict=True)}  # fmt: skip
    return [table("", {"s": found | {
        "the list's first byte": f"{first_s:.3f}", "whole": f"{whole_s:.3f}",
        "usable in it": str(usable),
    }}), (
        f"{NOT_MET}{what}: {s:.2f}; {most:g} is allowed"
        for what, s, most in (("the answer over the command's", max(page / own), MOST_TIMES),
                              ("s of the list", whole_s, MOST_LIST_S)) if s > most
    )]  # fmt: skip
