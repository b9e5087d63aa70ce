"""Replays an hour at 20 Hz to MCAP and .rrd, compared with only reading the log by pymavlink.

The logs have the messages of real links, see long_log.py. pymavlink reads every message and drops
it, or reads only those that yawid needs, which is cheaper as it indexes the file. The last row of a
log is ``yawid inspect``, compared with a replay without outputs. Its aim is at most three such
replays for a log of some 20 MB (``--hours .8 --mix raised``).
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

from checks.children import Cost, cost_of
from flights.long_log import MIXES, write_log
from pymavlink import mavutil

from bench.table import head, line, options_of

ANSWERED = (0, 5)
"""Exit codes of a log with a usable answer, and of one without."""
WANTED = ["ATTITUDE", "SERVO_OUTPUT_RAW", "HEARTBEAT", "VFR_HUD"]


def bare_pymavlink(path: Path, wanted: list[str] | None) -> tuple[float, float]:
    """Return CPU and wall time in s for reading all wanted messages by pymavlink."""
    start, cpu = time.perf_counter(), time.process_time()
    log = mavutil.mavlink_connection(str(path))
    while log.recv_match(type=wanted) is not None:
        pass
    return time.process_time() - cpu, time.perf_counter() - start


_WITHOUT_OUTPUTS = """
import sys
from pathlib import Path
from yawid.config.run import RunConfig
from yawid.pipeline import Pipeline
from yawid.results.summary import summarise
from yawid.runs.job import feed_all, open_log
source, pipeline = open_log(Path(sys.argv[1])), Pipeline(RunConfig())
feed_all(source, pipeline)
summarise(pipeline, source.link, sys.argv[1], source.sha256)
"""


def replay(path: Path, out: Path, rerun: str) -> Cost:
    """Return the cost of a replay in a process of its own."""
    to = ["--out", str(out), "--force", "--json", "--rerun", rerun]
    return cost_of("-m", "yawid", "replay", str(path), *to, allowed=ANSWERED)


def bench(mix: str, folder: Path, options: argparse.Namespace) -> Iterator[str]:
    """Yield the rows of a log with one mix of messages."""
    log = folder / f"{mix}.tlog"
    each_s = write_log(log, options.hours, mix) / options.hours / 3600.0
    bare = [
        min(bare_pymavlink(log, wanted) for _ in range(options.repeat)) for wanted in (None, WANTED)
    ]
    for what, rerun in (("MCAP", "off"), ("MCAP and .rrd", "save")):
        runs = [replay(log, folder / rerun, rerun) for _ in range(options.repeat)]
        ratios = " / ".join(f"{best(runs).cpu_s / other:.2f}" for other, _ in bare)
        name = f"{mix}, {each_s:.0f} messages a second, to {what}"
        yield row(name, runs, ratios)
    yield inspect(log, f"{mix}, {each_s:.0f} messages a second", options.repeat)


def inspect(log: Path, name: str, repeat: int) -> str:
    """Return the row of ``yawid inspect``; it and the replays run in processes of their own."""
    bare = [cost_of("-c", _WITHOUT_OUTPUTS, str(log)) for _ in range(repeat)]
    asked = ["-m", "yawid", "inspect", str(log), "--json"]
    runs = [cost_of(*asked, allowed=ANSWERED) for _ in range(repeat)]
    bare_s = best(bare).cpu_s
    ratio = f"{best(runs).cpu_s / bare_s:.2f} (a replay without outputs: {bare_s:.1f} s)"
    return row(f"{name}, {log.stat().st_size / 1e6:.0f} MB, inspect", runs, ratio)


def best(runs: Sequence[Cost]) -> Cost:
    """Return the run that took the least CPU time."""
    return min(runs, key=lambda run: run.cpu_s)


def row(name: str, runs: Sequence[Cost], ratio: str) -> str:
    """Return the row of some runs: the seconds of the best one, and the highest peak of memory."""
    least, peak_mb = best(runs), max(run.peak_mb for run in runs)
    return line(name, f"{least.cpu_s:.1f}", f"{least.wall_s:.1f}", ratio, f"{peak_mb:.0f}")


def main(arguments: list[str]) -> Iterator[str]:
    """Yield the table."""
    own = {"hours": 1.0, "mix": tuple(MIXES), "repeat": 3}
    options = options_of("replay", __doc__, arguments, **own)
    over = "CPU over pymavlink's, every message / the wanted"
    yield from head("", ("CPU s", "wall s", over, "peak MB"))
    with tempfile.TemporaryDirectory() as folder:
        for mix in options.mix:
            yield from bench(mix, Path(folder), options)
