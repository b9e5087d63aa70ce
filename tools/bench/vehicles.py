"""Many vehicles on one port: loss, CPU per vehicle, latency, and the delay of manoeuvres.

Each vehicle sends ATTITUDE and SERVO_OUTPUT_RAW at 50 Hz, and all fly a doublet at the same time.
The sender and ``yawid live --sysid all`` are processes of their own on loopback. With up to
``--same`` vehicles, every vehicle's tlog is also replayed: estimates, manoeuvres and flight must
equal the session's, bit for bit. The delay of a manoeuvre is the time from its end to the line that
reports it; up to 1.3 s of it pass until the end is known. CPU time includes the session's children.
"""

from __future__ import annotations

import argparse
import json
import math
import re
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Iterator
from heapq import merge
from pathlib import Path
from statistics import median
from typing import IO, Any

import numpy as np
import psutil
from flights.drawn import drawn
from flights.hands import count
from flights.plan import STEP_S, FlightPlan
from flights.surgery import Record, join, split
from flights.telemetry import GCS, Link, telemetry

from bench.live import ENDING_S, is_as_replayed, sender, session
from bench.table import head, line, options_of
from yawid.plant.yaw import YawPlant
from yawid.sources.link.tap import sysid_of

SECONDS, STARTS_S, DOUBLET_S = 30.0, 5.0, 14.0
WARM_S = 3.0
"""Time in s before the first frame, so that imports and first use are not counted."""
SETTLED_S = 3.0
"""Time in s after the last frame, for fits and waiting frames."""
LATE_S = 0.2
REPORTED = re.compile(r"system (\d+): manoeuvre 1 \(\d+ to (\d+) s")


def vehicle(sysid: int) -> Iterator[Record]:
    """Yield the frames of one vehicle, which has its own Dutch roll, excited by a doublet.

    The vehicles start one after the other within STARTS_S, and fly their doublets at once.
    """
    rng = np.random.default_rng(sysid)
    wn, zeta = rng.uniform(2.0, 4.0), rng.uniform(0.1, 0.3)
    start_s = round(rng.uniform(0.0, STARTS_S), 3) * (sysid > 1)
    seconds = SECONDS - start_s
    n = count(seconds)
    t = np.arange(n) * STEP_S - (DOUBLET_S - start_s)
    half_s = 0.5 * math.pi / wn * 1.6
    u = 0.3 * ((t >= 0.0) & (t < half_s)) - 0.3 * ((t >= half_s) & (t < 2.0 * half_s))
    r = YawPlant(0.6, 0.8, wn, zeta).linear().simulate(u, STEP_S)[:, 0]
    columns = {"r": r, "rudder": u, "airspeed": np.full(n, 20.0), "groundspeed": np.full(n, 20.0)}
    plan = FlightPlan(seconds=seconds, manoeuvre="none")
    link = Link(boot_s=Link().boot_s + start_s, seed=sysid, sysid=sysid)
    for stamp_us, frame in telemetry(link, drawn(plan, columns)):
        if sysid == 1 or sysid_of(frame) != GCS[0]:  # one ground station is enough
            yield stamp_us + round(1e6 * start_s), frame


class Reports(threading.Thread):
    """Reads a session's stderr; ``at_s`` is when each vehicle's first manoeuvre was reported."""

    def __init__(self, stream: IO[str]) -> None:
        super().__init__(daemon=True)
        self.at_s: dict[int, float] = {}
        self.lines: list[str] = []
        self._stream = stream

    def run(self) -> None:
        """Read until the session ends."""
        for said in self._stream:
            self.lines.append(said)
            if found := REPORTED.search(said):
                self.at_s[int(found[1])] = time.time()


def cpu_s(process: int) -> tuple[float, float]:
    """Return the CPU time in s that a process and its children have used: in all, and as user."""
    main = psutil.Process(process)
    times = [each.cpu_times() for each in (main, *main.children())]
    return sum(each.user + each.system for each in times), sum(each.user for each in times)


def flown(log: Path, folder: Path) -> dict[str, Any]:
    """Send a log to a session; return what was sent, its CPU time, its lines and summaries."""
    with session(folder, "--sysid", "all", "--most-vehicles", 255) as (process, port):
        assert process.stdout is not None
        assert process.stderr is not None
        reports = Reports(process.stderr)
        reports.start()
        time.sleep(WARM_S)
        before_s, before_user_s = cpu_s(process.pid)
        with sender(port, log) as vehicles:
            sent: dict[str, Any] = json.loads(vehicles.communicate(timeout=ENDING_S)[0])
        used_s = cpu_s(process.pid)[0] - before_s
        time.sleep(SETTLED_S)
        user_s = cpu_s(process.pid)[1] - before_user_s
        process.terminate()
        summaries = [json.loads(line) for line in process.stdout]
        reports.join(ENDING_S)
    return sent | {"cpu_s": used_s, "user_s": user_s, "reports": reports, "summaries": summaries}


def lost(summaries: list[dict[str, Any]], log: Path) -> int:
    """Return how many frames that vehicles sent are missing in their tlogs."""
    sent = Counter(sysid_of(frame) for _, frame in split(log.read_bytes()))
    del sent[GCS[0]]
    for each in summaries:
        sysid, tlog = each["vehicle"]["sysid"], Path(each["files"]["tlog"])
        sent[sysid] -= sum(sysid_of(f) == sysid for _, f in split(tlog.read_bytes()))
    return sum(sent.values())


def delays_s(got: dict[str, Any]) -> list[float]:
    """Return the time in s from the end of each vehicle's manoeuvre to its report."""
    ends = {e["vehicle"]["sysid"]: e["manoeuvres"][:1] for e in got["summaries"]}
    at_start_s = got["begun_s"] - Link().boot_s
    reports = got["reports"].at_s
    return [reports[n] - at_start_s - e["to_s"] for n, found in ends.items() for e in found]


def row(vehicles: list[list[Record]], options: argparse.Namespace) -> str:
    """Return the table's row for these vehicles."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        log = folder / "sent.tlog"
        log.write_bytes(join(merge(*vehicles)))
        got = flown(log, folder / "out")
        summaries, waits = got["summaries"], delays_s(got)
        missing, count = lost(summaries, log), len(vehicles)
        same = [is_as_replayed(e, folder) for e in summaries] if count <= options.same else []
    if got["latest_s"] > LATE_S:
        print(f"the sender was {got['latest_s']:.2f} s late", file=sys.stderr)
    behind = any("behind the link" in line for line in got["reports"].lines)
    dropped = sum(summaries[0]["live"]["dropped"].values())
    percent = 100.0 * got["cpu_s"] / SECONDS
    worst = [max(e["live"]["latency_ms"][of] for e in summaries) for of in ("p50", "p99", "max")]
    cells = [
        f"{count}, {got['sent'] / SECONDS:.0f} msg/s",
        f"{missing} of {got['sent']}, {dropped}" + (", behind" if behind else ""),
        f"{percent:.0f}, {percent / count:.2f}",
        ", ".join(f"{ms:.0f}" for ms in worst),
        f"{len(waits)}: {median(waits):.1f}, {max(waits):.1f} s; {got['user_s']:.1f}",
        f"{sum(same)} of {len(same)}" if same else "",
    ]
    return line(*cells)


def main(arguments: list[str]) -> Iterator[str]:
    """Yield the table."""
    own = {"vehicles": (1, 10, 50, 100, 254), "same": 50}
    options = options_of("vehicles", __doc__, arguments, **own)
    logs = [list(vehicle(sysid)) for sysid in range(1, 1 + max(options.vehicles))]
    latency, delay = "worst latency, ms: p50, p99, max", "delay: median, last; user s"
    yield from head("", ("frames lost, dropped", "CPU %, each", latency, delay, "replayed"))
    for vehicles in options.vehicles:
        yield row(logs[:vehicles], options)
