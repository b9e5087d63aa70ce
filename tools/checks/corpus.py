"""Make logs with a known answer and logs that have none; count how often the verdict errs.

    python -m checks.corpus make DIR [--excited 200] [--unexcited 210] [--jobs 2]
    python -m checks.corpus line DIR
    python -m checks.corpus judge DIR [--runs default,forgetting,remedy,inspect] [--readme]

``make`` writes DIR/NAME.tlog and DIR/NAME.json, the truth: flights of JSBSim whose rudder is moved
on purpose, half of them in turbulence (tools/flights/free.py), and logs in which nothing excites
it (tools/flights/quiet.py). The same numbers give the same bytes. ``line`` writes the one flight by
hand whose gyro has a line of 2.4 Hz. ``judge`` replays each log without files, writes
DIR/judged.csv, a row per log and run, and prints counts.
"""

from __future__ import annotations

import argparse
import csv
import json
import sys
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from cases.recipes import Made
from flights.free import excited
from flights.quiet import lined, unexcited

from checks.corpus_judge import RUNS, Row, counts, judged, table
from checks.readme_tables import put

MAKERS: dict[str, Callable[[int], Made]] = {"excited": excited, "unexcited": unexcited}
MOST_JOBS = 2
RESULT = "judged.csv"


def write(folder: Path, task: tuple[str, int]) -> str:
    """Make one log and its truth; return its name."""
    kind, number = task
    return save(folder, f"{kind}_{number:03d}", kind, MAKERS[kind](number))


def save(folder: Path, name: str, kind: str, made: Made) -> str:
    """Write a log and its truth; return its name."""
    (folder / f"{name}.tlog").write_bytes(made.log)
    told = {"name": name, "kind": kind} | (made.truth or {})
    (folder / f"{name}.json").write_text(json.dumps(told, indent=1) + "\n", encoding="utf-8")
    return name


def make(folder: Path, excited_count: int, unexcited_count: int, jobs: int) -> None:
    """Make the corpus."""
    folder.mkdir(parents=True, exist_ok=True)
    tasks = [("excited", i) for i in range(excited_count)]
    tasks += [("unexcited", i) for i in range(unexcited_count)]
    for name in in_processes(partial(write, folder), tasks, jobs):
        print(name, flush=True)


def judge(folder: Path, runs: Sequence[str], jobs: int) -> list[Row]:
    """Judge every log of a folder, write the table, return its rows."""
    truths = sorted(folder.glob("*.json"))
    rows = []
    for found in in_processes(partial(judged, runs=tuple(runs)), truths, jobs):
        rows += found
        print(f"\r{rows[-1]['name']} ", end="", file=sys.stderr, flush=True)
    names = list(dict.fromkeys(name for row in rows for name in row))
    with (folder / RESULT).open("w", newline="", encoding="utf-8") as file:
        table = csv.DictWriter(file, names, lineterminator="\n")
        table.writeheader()
        table.writerows(rows)
    return rows


def in_processes(do: Callable[[Any], Any], tasks: Sequence[Any], jobs: int) -> Iterable[Any]:
    """Yield what ``do`` returns of each task, in their order."""
    if jobs == 1:
        yield from map(do, tasks)
        return
    with ProcessPoolExecutor(min(jobs, MOST_JOBS), get_context("spawn")) as pool:
        yield from pool.map(do, tasks)


def parse(argv: Sequence[str]) -> argparse.Namespace:
    """Return the options."""
    parser = argparse.ArgumentParser(
        prog="corpus.py",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    commands = parser.add_subparsers(dest="command", required=True)
    maker = commands.add_parser("make", help="write logs and truths")
    maker.add_argument("--excited", type=int, default=200)
    maker.add_argument("--unexcited", type=int, default=210)
    judging = commands.add_parser("judge", help="replay, compare, count")
    judging.add_argument(
        "--runs",
        type=lambda text: text.split(","),
        default=["default", "forgetting"],
        help=f"of {', '.join(RUNS)}; (default,forgetting)",
    )
    judging.add_argument("--readme", action="store_true", help="the counts to tools/README.md")
    line = commands.add_parser("line", help="write the flight whose gyro has a line")
    for command in (maker, judging, line):
        command.add_argument("folder", type=Path, metavar="DIR")
        command.add_argument("--jobs", type=int, default=2, help="processes, at most 2")
    options = parser.parse_args(argv)
    if options.jobs < 1:
        parser.error("--jobs must be 1 or 2")
    if options.command == "judge" and (unknown := set(options.runs) - RUNS.keys()):
        parser.error(f"no such run: {', '.join(sorted(unknown))}")
    return options


def main(argv: Sequence[str]) -> int:
    """Make or judge; return 0."""
    options = parse(argv)
    if options.command == "make":
        make(options.folder, options.excited, options.unexcited, options.jobs)
    elif options.command == "line":
        options.folder.mkdir(parents=True, exist_ok=True)
        print(save(options.folder, "line", "excited", lined()))
    else:
        rows = judge(options.folder, options.runs, options.jobs)
        print("\n" + counts(rows))
        if options.readme:
            put("verdict", table(rows))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
