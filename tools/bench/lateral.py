"""Judges the bare airframe of flights under a roll hold against its linearisation.

    python tools/bench.py lateral [--seed 913] [--flights 120] [--sealed] [--logs DIR] [--jobs 2]
                                  [--csv FILE] [--readme]

The flights are those of flights/moved.py whose aileron is moved, too, or follows the roll hold
alone, which hears the noisy signals. They are replayed with ``--lateral auto``; the figures are of
the airframes that pass all gates. With ``--sealed`` the sealed aircraft fly (bench/frame.py). The
exit code is 1 if the airframes of flights with a moved aileron are off by more than their sigma.
"""

from __future__ import annotations

from collections.abc import Generator
from functools import partial
from pathlib import Path

from checks.judge import Row, judged, kept
from flights.moved import AILERONS, PER_PLACE_OF_AILERON, PLACES, SEVERITIES, Draw, with_aileron
from flights.plan import sealed_places

from bench.frame import FLOWN, all_rows, begin, head, line, options_of
from bench.truth import COLUMNS, IN_2_PCT, MOST_Z, cells, criterion, errors, estimates, missed
from yawid.config.run import RunConfig

SEED, STRIDE = 913, 7
"""The gates were chosen with the seeds 701 and 812; a few flights, STRIDE apart, mix all
conditions."""
FACTS = ("number", "aircraft", "speed_kt", "severity", "aileron")


def rows_of(draw: Draw, folder: Path, number: int) -> list[Row]:
    """Fly, or take from the folder, and judge; return the rows of the bare airframe."""
    name = f"aileron_{draw.seed}_{number:03d}"
    log, truth = kept(folder, name, partial(with_aileron, draw, number))
    rows = judged(log, truth, RunConfig(lateral="auto"))
    return [{name: truth[name] for name in FACTS} | row for row in rows if row["kind"] == "bare"]


def main(arguments: list[str]) -> Generator[str, None, str | None]:
    """Yield a table by aileron and severity and one by aircraft; return the criteria missed."""
    own = {"seed": SEED, "flights": 0, "sealed": False}
    options = options_of("lateral", __doc__, arguments, **own, **FLOWN)
    run = begin("lateral") if options.sealed else None
    draw = Draw(run.seed, sealed_places()) if run else Draw(options.seed, PLACES)
    count = PER_PLACE_OF_AILERON * len(draw.places)
    numbers = [i * STRIDE % count for i in range(options.flights or count)]
    rows = all_rows(options, partial(rows_of, draw), numbers)
    by = {name: [row for row in rows if row["aileron"] == name] for name in AILERONS}
    moved = by[AILERONS[0]]
    if run:
        run.note(dict(zip(COLUMNS, cells(moved, "bare"), strict=True)))
    yield from head("", COLUMNS)
    for name, its in by.items():
        yield line(f"aileron {name}", *cells(its, "bare"))
        for severity in SEVERITIES[:-1]:
            some = [row for row in its if row["severity"] == severity]
            yield line(f"severity {severity}", *cells(some, "bare"))
    for name in dict.fromkeys(row["aircraft"] for row in moved):
        yield line(name, *cells([row for row in moved if row["aircraft"] == name], "bare"))
    limits = ("z", MOST_Z), ("in 2 sigma %", IN_2_PCT)
    return missed(
        criterion(number, figure, errors(estimates(moved, "bare"), number), limit)
        for number in ("wn", "zeta")
        for figure, limit in limits
    )
