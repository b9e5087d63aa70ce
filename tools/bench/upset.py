"""Whole flights with gusts, a go-around and a landing: nothing in them may be a usable manoeuvre.

    python tools/bench.py upset [--seeds 100] [--logs DIR] [--jobs 2]

The plan upset (flights/legs.py) is flown in turbulence and replayed with the default options. Below
the table are the manoeuvres that are usable all the same. The exit code is 1 if there is one, or if
a replay fails.
"""

from __future__ import annotations

import argparse
from collections.abc import Generator
from functools import partial
from pathlib import Path

from checks.judge import Row, folder_of, in_processes, judged, kept, options_of
from flights.fly import fly
from flights.legs import PLANS
from flights.telemetry import Link


def rows_of(folder: Path, seed: int) -> list[Row]:
    """Return a row for each manoeuvre found in one upset, flown if the folder does not have it yet.

    A replay that fails gives one row, so that the other flights are still judged.
    """
    log, truth = kept(folder, f"upset_{seed:03d}", partial(fly, PLANS["upset"], Link(seed=seed)))
    try:
        rows = judged(log, truth)
    except Exception as error:  # any failure is counted
        return [{"seed": seed, "kind": "broken", "usable": False, "error": repr(error)}]
    return [{"seed": seed} | row for row in rows if row["kind"] == "manoeuvre"]


def main(arguments: list[str]) -> Generator[str, None, str | None]:
    """Yield the table; return how many are usable or broken, None if none is."""
    parser = argparse.ArgumentParser(prog="bench.py upset", description=__doc__)
    parser.add_argument("--seeds", type=int, default=100)
    options_of(parser)
    options = parser.parse_args(arguments)
    with folder_of(options.logs) as folder:
        rows = in_processes(partial(rows_of, folder), range(1, 1 + options.seeds), options.jobs)
    broken = [row for row in rows if row["kind"] == "broken"]
    usable = [row for row in rows if row["usable"]]
    yield "| | flights | found | usable | replays broke off |"
    yield "|---|---|---|---|---|"
    counts = (options.seeds, len(rows) - len(broken), len(usable), len(broken))
    yield f"| manoeuvres | {' | '.join(map(str, counts))} |"
    yield ""
    for row in usable:
        yield "seed {seed}, {leg}, {from_s:.0f} to {to_s:.0f} s: wn {wn:.2f}".format(**row)
    yield from (f"seed {row['seed']}: {row['error']}" for row in broken)
    return f"{len(usable)} usable, {len(broken)} broken" if usable or broken else None
