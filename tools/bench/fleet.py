"""``yawid fleet`` on many logs: each must have one row and an answer, whatever is killed.

    python tools/bench.py fleet [--count 2000] [--workers 2] [--kill-every 30]

The logs are of 1 to 4 minutes, of PLANES aircraft over a year, each with its own Dutch roll. They
are run while every ``--kill-every`` seconds one process that replays is killed with -9; then they
are run again, which must change no file. The exit code is 1 if an outcome is wrong.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Generator, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import psutil
from checks.children import LONG_S, child
from flights.long_log import RATE_HZ, START_US, Plant, write_log
from scipy.signal import cont2discrete

from bench.frame import head, line, options_of
from yawid.dataset.files import read_table

LOOK_S = 0.5
PLANES, MINUTES, YEAR_US = 20, (1.0, 4.0), 365 * 86_400 * 10**6


@dataclass(slots=True)
class Watched:
    """What was measured in one run: time, peak memory of a child, how many were killed, CPU."""

    wall_s: float = 0.0
    worker_mb: float = 0.0
    kills: int = 0
    cpu_s: dict[int, float] = field(default_factory=dict)
    """The CPU time in s of each child by its process id."""


def run_fleet(logs: Path, out: Path, workers: int, kill_every_s: float = 0.0) -> Watched:
    """Run ``yawid fleet`` to its end and watch it; kill one child every ``kill_every_s`` s.

    Raises:
        SystemExit: it ended with an exit code other than 0.
    """
    seen, start_s = Watched(), time.perf_counter()
    command = [sys.executable, "-m", "yawid", "fleet", str(logs), "--out", str(out)]
    command += ["--workers", str(workers)]
    with child(command, LONG_S, stdout=subprocess.DEVNULL) as process:
        main, next_s = psutil.Process(process.pid), start_s + kill_every_s
        while process.poll() is None:
            time.sleep(LOOK_S)
            try:
                some = main.children(recursive=True)
                some = [each for each in some if "yawid.fleet.one_log" in each.cmdline()]
                for worker in some:
                    seen.worker_mb = max(seen.worker_mb, worker.memory_info().rss / 1e6)
                    seen.cpu_s[worker.pid] = sum(worker.cpu_times()[:2])
                if kill_every_s and time.perf_counter() > next_s:
                    next_s += kill_every_s
                    some[seen.kills % workers].kill()
                    seen.kills += 1
            except (psutil.Error, IndexError):
                continue  # the child has ended, or is just starting again
    seen.wall_s = time.perf_counter() - start_s
    if process.returncode:
        raise SystemExit(f"yawid fleet ended with {process.returncode}")
    return seen


def plant_of(plane: int) -> Plant:
    """Return an aircraft's discrete model; its wn is 2 to 5 rad/s, its zeta 0.1 to 0.4."""
    rng = np.random.default_rng((7, plane))
    wn, zeta = rng.uniform(2.0, 5.0), rng.uniform(0.1, 0.4)
    gain, lead_s = rng.uniform(0.3, 0.8), rng.uniform(0.5, 2.0)
    continuous = ([gain * wn**2 * lead_s, gain * wn**2], [1.0, 2.0 * zeta * wn, wn**2])
    b, a, _ = cont2discrete(continuous, 1.0 / RATE_HZ)
    return b[0].tolist(), a.tolist()


def make(folder: Path, count: int, seed: int = 1) -> None:
    """Write ``count`` logs of MINUTES each."""
    rng = np.random.default_rng(seed)
    for i in range(count):
        plane = int(rng.integers(PLANES))
        path = folder / f"plane_{plane:02d}" / f"{i:04d}.tlog"
        path.parent.mkdir(parents=True, exist_ok=True)
        every_s, hours = rng.uniform(60.0, 180.0), rng.uniform(*MINUTES) / 60.0
        start_us = START_US + int(rng.integers(YEAR_US))
        write_log(
            path, hours, "raised", (seed, i), 8.0, every_s, plant=plant_of(plane), start_us=start_us
        )


def faults(folder: Path, out: Path) -> Iterator[str]:
    """Yield the mistakes in a data set in words."""
    rows = read_table(out, "logs").to_pylist()
    counts = Counter(row["path"] for row in rows)
    for path in {str(path.absolute()) for path in folder.rglob("*.tlog")} | counts.keys():
        if counts[path] != 1:
            yield f"{path}: {counts[path]} rows"
    flown = Counter(read_table(out, "flights")["log_sha256"].to_pylist())
    for row in rows:
        if (row["outcome"], flown[row["log_sha256"]]) != ("ok", row["flights"]):
            yield f"{row['path']}: {row['outcome']}, {row['text']}, {row['flights']} flights"


def main(arguments: list[str]) -> Generator[str, None, str | None]:
    """Yield the table; return what is wrong, None if nothing is."""
    options = options_of("fleet", __doc__, arguments, count=2000, workers=2, kill_every=30.0)
    with tempfile.TemporaryDirectory() as name:
        folder, out = Path(name) / "logs", Path(name) / "out"
        make(folder, options.count)
        seen = run_fleet(folder, out, options.workers, options.kill_every)
        before = {path: path.stat().st_mtime_ns for path in out.rglob("*.parquet")}
        again = run_fleet(folder, out, options.workers)
        wrong = list(faults(folder, out))
        if before != {path: path.stat().st_mtime_ns for path in out.rglob("*.parquet")}:
            wrong.append("the second run changed files")
        outcomes = Counter(read_table(out, "logs")["outcome"].to_pylist())
    yield from head("", ("logs", "s", "kills", "CPU s a log", "MB a worker", "again, s", "wrong"))
    cost = sum(seen.cpu_s.values()) / outcomes.total()
    measured = f"{seen.wall_s:.0f}", seen.kills, f"{cost:.2f}", f"{seen.worker_mb:.0f}"
    shown = ", ".join(f"{count} {name}" for name, count in outcomes.most_common())
    yield line(shown, outcomes.total(), *measured, f"{again.wall_s:.1f}", len(wrong))
    return "\n".join(wrong) or None
