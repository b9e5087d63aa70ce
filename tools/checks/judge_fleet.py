"""Judges ``yawid fleet`` on many logs: each must have one right outcome, whatever is killed.

    python -m checks.judge_fleet LOGS OUT [--workers 2] [--kill-every 30] [--share 0.1]

LOGS is made by flights/fleet_logs.py. First, a part of the logs (``--share``) is replayed in one
plain process and then by the workers, to compare throughput and memory. Then all logs are run,
while every ``--kill-every`` seconds one process that replays is killed with -9. Then all are run
again, which must change no file.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import psutil

from checks.children import LONG_S, child
from yawid.dataset.files import read_table
from yawid.dataset.schema import TABLES

ONE_PROCESS: Final = """
import sys, time
from pathlib import Path
from yawid.fleet.one_log import rows_of
from yawid.fleet.spec import Spec
first, *logs = map(Path, sys.argv[1:])
rows_of(first, Spec())
wall_s, cpu_s = time.perf_counter(), time.process_time()
for log in logs:
    rows_of(log, Spec())
print(time.perf_counter() - wall_s, time.process_time() - cpu_s)
"""
LOOK_S: Final = 0.5


@dataclass(slots=True)
class Watched:
    """What was measured in one run of ``yawid fleet``.

    ``wall_s`` is its time in s, ``worker_mb`` the peak memory of a child, ``kills`` how many were
    killed, and ``cpu_s`` the CPU time in s of each child by its process id.
    """

    wall_s: float = 0.0
    worker_mb: float = 0.0
    kills: int = 0
    cpu_s: dict[int, float] = field(default_factory=dict)


def workers_of(main: psutil.Process) -> list[psutil.Process]:
    """Return the child processes of a run that replay logs, one for each worker."""
    return [p for p in main.children(recursive=True) if "yawid.fleet.one_log" in p.cmdline()]


def run_fleet(paths: Sequence[str], out: Path, workers: int, kill_every_s: float = 0.0) -> Watched:
    """Run ``yawid fleet`` to its end and watch it; kill one child every ``kill_every_s`` s.

    Raises:
        SystemExit: it ended with an exit code other than 0.
    """
    seen, start_s = Watched(), time.perf_counter()
    command = [sys.executable, "-m", "yawid", "fleet", *paths, "--out", str(out)]
    command += ["--workers", str(workers)]
    with child(command, LONG_S, stdout=subprocess.DEVNULL) as process:
        main, next_s = psutil.Process(process.pid), start_s + kill_every_s
        while process.poll() is None:
            time.sleep(LOOK_S)
            try:
                for worker in workers_of(main):
                    seen.worker_mb = max(seen.worker_mb, worker.memory_info().rss / 1e6)
                    seen.cpu_s[worker.pid] = sum(worker.cpu_times()[:2])
                if kill_every_s and time.perf_counter() > next_s:
                    next_s += kill_every_s
                    workers_of(main)[seen.kills % workers].kill()
                    seen.kills += 1
            except (psutil.Error, IndexError):
                continue  # the child has ended, or is just starting again
    seen.wall_s = time.perf_counter() - start_s
    if process.returncode:
        raise SystemExit(f"yawid fleet ended with {process.returncode}")
    return seen


def throughput(logs: Sequence[Path], out: Path, workers: int) -> None:
    """Print the rate of the workers and of one process, in wall time and CPU."""
    command = [sys.executable, "-c", ONE_PROCESS, str(logs[0]), *map(str, logs)]
    used = subprocess.run(command, check=True, capture_output=True, text=True).stdout.split()
    one_wall_s, one_cpu_s = map(float, used)
    seen = run_fleet([str(log) for log in logs], out, workers)
    n = len(logs)
    print(f"one process: {n / one_wall_s:.2f} logs/s, {one_cpu_s / n:.3f} CPU s a log")
    ratio, cpu_s = one_wall_s / seen.wall_s / workers, sum(seen.cpu_s.values())
    print(
        f"{workers} workers: {n / seen.wall_s:.2f} logs/s with start and end, {cpu_s / n:.3f} CPU s"
        f" a log; {ratio:.2f} of {workers} times one process; {seen.worker_mb:.0f} MB a worker"
    )


def faults(folder: Path, out: Path) -> list[str]:
    """Return the mistakes in a data set in words, by the truth of its logs."""
    truth: dict[str, dict[str, Any]] = json.loads((folder / "truth.json").read_bytes())
    rows = read_table(out, "logs").to_pylist()
    counts = Counter(row["path"] for row in rows)
    paths = {str(path.absolute()) for path in folder.rglob("*.tlog")}
    wrong = [f"{path}: {n} rows" for path, n in counts.items() if n != 1]
    wrong += [f"{path}: no row" for path in paths - counts.keys()]
    for row in rows:
        name = Path(row["path"]).relative_to(folder.absolute()).as_posix()
        expected = truth.get(name, {"outcomes": ["ok"], "reason": None, "damage": "none"})
        reason = expected["reason"]
        if row["outcome"] not in expected["outcomes"] or reason not in (None, *row["reasons"]):
            wrong.append(f"{name} ({expected['damage']}): {row['outcome']}, {row['text']}")
        if row["outcome"] != "ok" and not (row["reasons"] and row["text"]):
            wrong.append(f"{name}: {row['outcome']} without a reason")
    flown = Counter(read_table(out, "flights")["log_sha256"].to_pylist())
    for row in rows:
        if row["log_sha256"] is not None and flown[row["log_sha256"]] != row["flights"]:
            wrong.append(f"{row['path']}: {flown[row['log_sha256']]} flights, not {row['flights']}")
    return wrong


def differences(one: Path, other: Path) -> list[str]:
    """Return the tables in which the logs that both data sets have differ."""
    sets = one, other
    tables = {name: [read_table(each, name).to_pylist() for each in sets] for name in TABLES}
    paths = [{row["path"] for row in logs} for logs in tables["logs"]]
    both = paths[0] & paths[1]
    shas = {row["log_sha256"] for row in tables["logs"][0] if row["path"] in both}
    found = []
    for name, rows in tables.items():
        key, wanted = ("path", both) if name == "logs" else ("log_sha256", shas)
        a, b = ([row for row in each if row[key] in wanted] for each in rows)
        if a != b:
            found.append(f"{name}: {len(a)} and {len(b)} rows, not the same")
    return found


def main(argv: Sequence[str]) -> int:
    """Run all parts; return 1 if there is a mistake."""
    parser = argparse.ArgumentParser(prog="judge_fleet.py", description=__doc__.split("\n")[0])
    parser.add_argument("logs", type=Path, metavar="LOGS")
    parser.add_argument("out", type=Path, metavar="OUT")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--kill-every", type=float, default=30.0, metavar="S")
    parser.add_argument("--share", type=float, default=0.1)
    asked: Any = parser.parse_args(argv)
    sys.stdout.reconfigure(line_buffering=True)  # type: ignore[union-attr] # it may be a file
    logs = sorted(asked.logs.rglob("*.tlog"))
    some = logs[:: round(1.0 / asked.share)]
    quiet, killed = asked.out / "quiet", asked.out / "killed"
    throughput(some, quiet, asked.workers)
    seen = run_fleet([str(asked.logs)], killed, asked.workers, asked.kill_every)
    outcomes = Counter(read_table(killed, "logs")["outcome"].to_pylist())
    print(f"{len(logs)} logs in {seen.wall_s:.0f} s, {seen.kills} kills; {dict(outcomes)}")
    before = {path: path.stat().st_mtime_ns for path in killed.rglob("*.parquet")}
    again = run_fleet([str(asked.logs)], killed, asked.workers)
    touched = before != {path: path.stat().st_mtime_ns for path in killed.rglob("*.parquet")}
    print(f"once more: {again.wall_s:.1f} s, {'files touched' if touched else 'nothing touched'}")
    wrong = faults(asked.logs, killed) + differences(quiet, killed)
    wrong += ["the second run touched files"] * touched
    print("\n".join(wrong) or "every log once, every outcome as it should be")
    return bool(wrong)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
