"""Whole flights at three speeds: which manoeuvres are found, and how right each answer is.

    python tools/bench.py speeds [--seeds 4] [--severities 0 1 2 3] [--logs DIR] [--jobs 2]

The plan three_speeds (flights/legs.py) is flown in turbulence of each severity and replayed with
the default options. Every manoeuvre is compared with the truth at the airspeed flown. A usable
manoeuvre is right (within 2 % of wn and .02 of zeta), fair (wn within 5 %), wrong (wn more than
10 % off) or neither.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from checks.judge import Row, judged, kept
from flights.fly import fly
from flights.legs import PLANS, LegPlan
from flights.telemetry import Link

from bench.table import FLOWN, all_rows, head, line, options_of

RIGHT_PCT, RIGHT_ZETA, FAIR_PCT, WRONG_PCT = 2.0, 0.02, 5.0, 10.0
Task = tuple[int, int]
"""A flight: the severity of its turbulence, and its seed."""


def turbulent(plan: LegPlan, severity: int) -> LegPlan:
    """Return the plan in turbulence of one severity throughout."""
    return replace(plan, legs=tuple(replace(leg, severity=severity) for leg in plan.legs))


def rows_of(folder: Path, task: Task) -> list[Row]:
    """Return the rows of one flight, which is flown if the folder does not have it yet."""
    severity, seed = task
    plan = turbulent(PLANS["three_speeds"], severity)
    make = partial(fly, plan, Link(seed=seed))
    found = judged(*kept(folder, f"three_speeds_s{severity}_{seed:03d}", make))
    return [{"severity": severity, "seed": seed} | row for row in found]


def counts(rows: Sequence[Row]) -> tuple[int, ...]:
    """Return how many manoeuvres were flown, missed, found elsewhere and refused.

    Then follow how many usable ones are right, fair, neither and wrong.
    """
    found = [row for row in rows if row["kind"] == "manoeuvre"]
    missed = [row for row in rows if row["kind"] == "missed"]
    own = [row for row in found if row["of"] is not None]
    flown = {(row["seed"], row["of"]) for row in [*own, *missed]}
    usable = [row for row in own if row["usable"]]
    kinds = [how_right(row) for row in usable]
    counts = [kinds.count(kind) for kind in ("right", "fair", "neither", "wrong")]
    return len(flown), len(missed), len(found) - len(own), len(own) - len(usable), *counts


def how_right(row: Row) -> str:
    """Return how right a usable row is: right, fair, neither or wrong."""
    if row["wn_error_pct"] is None:
        return "wrong"
    wn_pct, zeta = abs(row["wn_error_pct"]), abs(row["zeta"] - row["zeta_true"])
    if wn_pct <= RIGHT_PCT and zeta <= RIGHT_ZETA:
        return "right"
    return "fair" if wn_pct <= FAIR_PCT else "wrong" if wn_pct > WRONG_PCT else "neither"


def main(arguments: list[str]) -> Iterator[str]:
    """Yield the table, a row for each severity."""
    own = {"seeds": 4, "severities": (0, 1, 2, 3)}
    options = options_of("speeds", __doc__, arguments, **own, **FLOWN)
    severities = options.severities
    tasks = [(severity, 1 + n) for severity in severities for n in range(options.seeds)]
    found = all_rows(options, rows_of, tasks)
    by = {severity: [r for r in found if r["severity"] == severity] for severity in severities}
    right = ("right", "fair", "neither", "wrong")
    yield from head("", ("flown", "missed", "elsewhere", "refused", *right))
    for severity, rows in by.items():
        yield line(f"severity {severity}", *counts(rows))
