"""An hour at 20 Hz to MCAP and .rrd, against bare pymavlink reading of the same log; memory too.

The logs carry what real links do, see long_log.py. pymavlink reads every message and does nothing
with it, or looks for the few that yawid needs, which its index of the file makes cheaper.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from long_log import MIXES, write_log
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


def replay(path: Path, out: Path, rerun: str) -> tuple[float, float, float]:
    """Return CPU and wall seconds and peak memory in MB of a replay in its own process."""
    command = ["replay", str(path), "--out", str(out), "--force", "--json", "--rerun", rerun]
    timed = [sys.executable, "-c", _TIMED, sys.executable, "-m", "yawid", *command]
    done = subprocess.run(timed, capture_output=True, text=True, check=True)
    code, cpu, wall, peak = json.loads(done.stdout)
    if code not in (0, 5):
        raise SystemExit(f"the replay ended with {code}: {done.stderr.strip()}")
    return cpu, wall, peak


def bench(mix: str, folder: Path, options: argparse.Namespace) -> None:
    """Print the rows of one mix of messages."""
    log = folder / f"{mix}.tlog"
    count = write_log(log, options.hours, mix)
    each_s = count / options.hours / 3600.0
    size = log.stat().st_size / 1e6
    print(f"\n{mix}: {options.hours:g} h, {each_s:.0f} messages a second, {size:.1f} MB")
    bare = []
    for what, wanted in (("every message", None), ("the wanted", WANTED)):
        if not options.no_bare:
            bare.append(min(bare_pymavlink(log, wanted) for _ in range(options.repeat)))
            cpu, wall = bare[-1]
            print(f"pymavlink, {what:13s}  CPU {cpu:5.2f} s, wall {wall:5.2f} s")
    for what, rerun in (("MCAP", "off"), ("MCAP and .rrd", "save")):
        runs = [replay(log, folder / rerun, rerun) for _ in range(options.repeat)]
        cpu, wall, _ = min(runs)
        peak = max(run[2] for run in runs)
        ratios = " and ".join(f"{cpu / other:.2f}" for other, _ in bare)
        print(f"yawid, {what:17s}  CPU {cpu:5.2f} s, wall {wall:5.2f} s, {peak:.0f} MB", end="")
        print(f", CPU ratios {ratios}" if bare else "")
    sizes = {p.suffix: p.stat().st_size / 1e6 for p in (folder / "save").glob(f"{mix}.*")}
    print(", ".join(f"{name} {size:.1f} MB" for name, size in sorted(sizes.items())))


def main(arguments: list[str]) -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(prog="bench.py replay", description=__doc__)
    parser.add_argument("--hours", type=float, default=1.0)
    parser.add_argument("--mix", choices=list(MIXES), nargs="+", default=list(MIXES))
    parser.add_argument("--repeat", type=int, default=3)
    parser.add_argument("--no-bare", action="store_true", help="leave pymavlink out")
    options = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as folder:
        for mix in options.mix:
            bench(mix, Path(folder), options)
