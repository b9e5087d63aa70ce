"""How often the verdict errs, on logs with a known answer and on logs without excitation.

    python tools/bench.py verdict [--excited 120] [--unexcited 210] [--take-off 0] [--misled 0]
                                  [--sealed] [--logs DIR] [--jobs 2] [--readme]

The logs are flights of JSBSim whose rudder is moved on purpose, half of them in turbulence
(flights/moved.py), and logs in which nothing excites the Dutch roll (flights/quiet.py). There are
also take-off rolls (flights/drawn.py) and flights with the rudder of another flight, with their own
reversed in time, and with one that is late (flights/misled.py). Below the table are the logs that
were judged wrongly, and the reasons that refused right answers. With ``--sealed`` the sealed
aircraft fly (bench/sealed.py): the logs are as many as SEALED says.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

from checks.judge import Row, judged, kept
from flights.drawn import take_off
from flights.fly import Made
from flights.misled import misled
from flights.moved import Draw, excited
from flights.quiet import unexcited
from flights.sealed import sealed_places

from bench.sealed import begin
from bench.table import FLOWN, all_rows, head, line, options_of
from yawid.config.run import RunConfig

RIGHT_PCT, WRONG_PCT = 5.0, 10.0
"""Limits of wn's error in %: an answer below the first is right, one above the second is wrong."""
MAKERS: dict[str, Callable[[int], Made]] = {
    "excited": excited,
    "unexcited": unexcited,
    "take_off": take_off,
    "misled": misled,
}
SEALED: dict[str, tuple[Callable[[int, Draw], Made], int]] = {
    "excited": (excited, 44), "unexcited": (unexcited, 28), "misled": (misled, 30),
}  # fmt: skip
"""The logs that sealed aircraft make, and how many there are in a sealed run."""
COLUMNS = ("usable without excitation", "right", "right, refused", "usable, wrong")
FALSE = ("unexcited", "take_off", "misled")
"""The kinds of logs of which none may be usable."""


def rows_of(draw: Draw | None, folder: Path, task: tuple[str, int]) -> list[Row]:
    """Return the row of one log; sealed aircraft fly it if their ``draw`` is given."""
    kind, number = task
    name, make = f"{kind}_{number:03d}", partial(MAKERS[kind], number)
    if draw:
        name, make = f"sealed_{draw.seed}_{name}", partial(SEALED[kind][0], number, draw)
    log, truth = kept(folder, name, make)
    (row,) = (row for row in judged(log, truth, RunConfig()) if row["kind"] == "flight")
    return [row | {"name": name, "log": kind, "group": truth["group"], "run": "default"}]


def off_pct(row: Row) -> float:
    """Return the absolute error of wn in %; infinity without an answer."""
    error = row.get("wn_error_pct")
    return math.inf if error is None else abs(error)


def table(rows: list[Row], note: Callable[[dict[str, str]], None] | None = None) -> Iterator[str]:
    """Yield a table of both kinds of error, a row for each run; then the wrong judgements.

    ``note`` is called with the figures of each run.
    """
    yield from head("", COLUMNS)
    others = []
    for run in dict.fromkeys(row["run"] for row in rows):
        mine = [row for row in rows if row["run"] == run]
        quiet = [row for row in mine if row["log"] in FALSE]
        flights = [row for row in mine if row["log"] == "excited"]
        false = [row for row in quiet if row["usable"]]
        right = [row for row in flights if off_pct(row) < RIGHT_PCT]
        refused = [row for row in right if not row["usable"]]
        wrong = [row for row in flights if row["usable"] and off_pct(row) > WRONG_PCT]
        kinds = [kind for kind in FALSE if any(row["log"] == kind for row in quiet)]
        usable = ", ".join(
            f"{sum(row['log'] == kind for row in false)} of "
            f"{sum(row['log'] == kind for row in quiet)}"
            + (f" ({kind})" if kind != FALSE[0] else "")
            for kind in kinds
        )
        cells = usable, f"{len(right)} of {len(flights)}", str(len(refused)), str(len(wrong))
        yield line(run, *cells)
        if note:
            note({"run": run} | dict(zip(COLUMNS, cells, strict=True)))
        others += [f"{run}: {row['name']} ({row['group']}) is usable" for row in [*false, *wrong]]
        reasons = Counter(reason for row in refused for reason in row["fatal"].split())
        others += [f"{run}: {reason} refuses {n} right ones" for reason, n in reasons.items()]
    yield ""
    yield from others


def main(arguments: list[str]) -> Iterator[str]:
    """Yield the table."""
    logs = {"excited": 120, "unexcited": 210, "take_off": 0, "misled": 0}
    own = {"sealed": False}
    options = options_of("verdict", __doc__, arguments, **logs, **own, **FLOWN)
    if not options.sealed:
        tasks = [(kind, i) for kind in MAKERS for i in range(getattr(options, kind))]
        yield from table(all_rows(options, partial(rows_of, None), tasks))
        return
    run = begin("verdict")
    draw = Draw(run.seed, sealed_places())
    tasks = [(kind, i) for kind, (_, count) in SEALED.items() for i in range(count)]
    yield from table(all_rows(options, partial(rows_of, draw), tasks), run.note)
