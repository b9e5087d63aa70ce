"""Whole flights with gusts, a go-around and a landing: nothing in them may be a usable manoeuvre.

    python tools/bench.py upset [--seeds 100] [--logs DIR] [--jobs 2]

The plan upset (flights/legs.py) is flown in turbulence and replayed with the default options. Below
the table are the manoeuvres that are usable all the same. The exit code is 1 if there is one, or if
a replay fails.
"""

from __future__ import annotations

from collections.abc import Generator
from functools import partial
from pathlib import Path

from checks.judge import Row, judged, kept
from flights.fly import fly
from flights.legs import PLANS
from flights.telemetry import Link

from bench.table import FLOWN, all_rows, head, line, options_of


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
    options = options_of("upset", __doc__, arguments, seeds=100, **FLOWN)
    rows = all_rows(options, rows_of, range(1, 1 + options.seeds))
    broken = [row for row in rows if row["kind"] == "broken"]
    usable = [row for row in rows if row["usable"]]
    yield from head("", ("flights", "found", "usable", "replays broke off"))
    found = len(rows) - len(broken)
    yield line("manoeuvres", options.seeds, found, len(usable), len(broken))
    yield ""
    for row in usable:
        yield "seed {seed}, {leg}, {from_s:.0f} to {to_s:.0f} s: wn {wn:.2f}".format(**row)
    yield from (f"seed {row['seed']}: {row['error']}" for row in broken)
    return f"{len(usable)} usable, {len(broken)} broken" if usable or broken else None
