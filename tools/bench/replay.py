"""An hour at 20 Hz to MCAP and .rrd, against bare pymavlink reading of the same log; memory too.

The logs carry what real links do, see long_log.py. pymavlink reads every message and does nothing
with it, or looks for the few that yawid needs, which its index of the file makes cheaper. Then
``yawid inspect`` of the same log, against a replay of it without outputs: ``--hours .8 --mix
raised`` is a log of some 20 MB, of which inspect may cost three such replays.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from flights.long_log import MIXES, write_log
from pymavlink import mavutil

WANTED = ["ATTITUDE", "SERVO_OUTPUT_RAW", "HEARTBEAT", "VFR_HUD"]


# A process begins with its parent's peak of memory: this small one between has none.
_TIMED = """
import json, os, subprocess, sys, time
start = time.perf_counter()
process = subprocess.Popen(sys.argv[1:], stdout=subprocess.DEVNULL)
_, status, used = os.wait4(process.pid, 0)
wall, cpu = time.perf_counter() - start, used.ru_utime + used.ru_stime
print(json.dumps([os.waitstatus_to_exitcode(status), cpu, wall, used.ru_maxrss / 1024]))
"""


def bare_pymavlink(path: Path, wanted: list[str] | None) -> tuple[float, float]:
    """Return CPU and wall seconds until pymavlink has handed over the messages."""
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


def timed(*arguments: str) -> tuple[float, float, float]:
    """Return CPU and wall seconds and peak memory in MB of Python with these arguments."""
    command = [sys.executable, "-c", _TIMED, sys.executable, *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    code, cpu, wall, peak = json.loads(done.stdout)
    if code not in (0, 5):
        raise SystemExit(f"{' '.join(arguments)} ended with {code}: {done.stderr.strip()}")
    return cpu, wall, peak


def replay(path: Path, out: Path, rerun: str) -> tuple[float, float, float]:
    """Return CPU and wall seconds and peak memory in MB of a replay in its own process."""
    command = ["replay", str(path), "--out", str(out), "--force", "--json", "--rerun", rerun]
    return timed("-m", "yawid", *command)


def bench(mix: str, folder: Path, options: argparse.Namespace) -> Iterator[str]:
    """Yield the rows of one mix of messages."""
    log = folder / f"{mix}.tlog"
    each_s = write_log(log, options.hours, mix) / options.hours / 3600.0
    bare = [
        min(bare_pymavlink(log, wanted) for _ in range(options.repeat))
        for wanted in ((None, WANTED) if not options.no_bare else ())
    ]
    for what, rerun in (("MCAP", "off"), ("MCAP and .rrd", "save")):
        runs = [replay(log, folder / rerun, rerun) for _ in range(options.repeat)]
        cpu, wall, _ = min(runs)
        peak = max(run[2] for run in runs)
        ratios = " / ".join(f"{cpu / other:.2f}" for other, _ in bare)
        name = f"{mix}, {each_s:.0f} messages a second, to {what}"
        yield f"| {name} | {cpu:.1f} | {wall:.1f} | {ratios} | {peak:.0f} |"
    yield inspect(log, f"{mix}, {each_s:.0f} messages a second", options.repeat)


def inspect(log: Path, name: str, repeat: int) -> str:
    """Return the row of ``yawid inspect``, each in its own process as the replay it is held to."""
    bare = min(timed("-c", _WITHOUT_OUTPUTS, str(log)) for _ in range(repeat))
    runs = [timed("-m", "yawid", "inspect", str(log), "--json") for _ in range(repeat)]
    cpu, wall, _ = min(runs)
    peak = max(run[2] for run in runs)
    name = f"{name}, {log.stat().st_size / 1e6:.0f} MB, inspect"
    ratio = f"{cpu / bare[0]:.2f} (a replay without outputs: {bare[0]:.1f} s)"
    return f"| {name} | {cpu:.1f} | {wall:.1f} | {ratio} | {peak:.0f} |"


def main(arguments: list[str]) -> Iterator[str]:
    """Yield the table."""
    parser = argparse.ArgumentParser(prog="bench.py replay", description=__doc__)
    parser.add_argument("--hours", type=float, default=1.0)
    parser.add_argument("--mix", choices=list(MIXES), nargs="+", default=list(MIXES))
    parser.add_argument("--repeat", type=int, default=3)
    parser.add_argument("--no-bare", action="store_true", help="leave pymavlink out")
    options = parser.parse_args(arguments)
    yield "| | CPU s | wall s | CPU over pymavlink's, every message / the wanted | peak MB |"
    yield "|---|---|---|---|---|"
    with tempfile.TemporaryDirectory() as folder:
        for mix in options.mix:
            yield from bench(mix, Path(folder), options)
