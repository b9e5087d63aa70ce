"""How often the verdict errs, on logs with a known answer and on logs without excitation.

    python tools/bench.py verdict [--excited 120] [--unexcited 210] [--upset 0] [--misled 0]
                                  [--sealed] [--logs DIR] [--jobs 2] [--readme]

The logs are flights of JSBSim whose rudder is moved on purpose, half of them in turbulence
(flights/moved.py), and logs in which nothing excites the Dutch roll (flights/quiet.py). There are
also whole flights with gusts, a go-around and a landing (the plan upset), and flights with the
rudder of another flight, with their own reversed in time, and with one that is late
(flights/quiet.py). The table says how many are usable, how many of these are right and wrong, and
which fatal reason came first in how many others. Below it are the logs that were judged wrongly.
The exit code is 1 if a quiet log or an upset is usable, more than one misled log, or an excited one
that is wrong. With ``--sealed`` the sealed aircraft fly (bench/frame.py): the logs are as many as
SEALED says.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Generator, Iterator, Sequence
from functools import partial
from pathlib import Path

from checks.judge import Row, judged, kept
from flights.fly import Made, fly
from flights.moved import Draw, excited
from flights.plan import read_plan, sealed_places
from flights.quiet import misled, unexcited
from flights.telemetry import Link

from bench.frame import FLOWN, all_rows, begin, head, line, options_of
from yawid.config.run import RunConfig

NOT_JUDGED = "not judged"
RIGHT_PCT, WRONG_PCT = 5.0, 10.0
"""Limits of wn's error in %: an answer below the first is right, one above the second is wrong."""
MAKERS: dict[str, Callable[[int], Made]] = {
    "excited": excited,
    "unexcited": unexcited,
    "upset": lambda number: fly(read_plan("upset"), Link(seed=1 + number), group="upset"),
    "misled": misled,
}
SEALED: dict[str, tuple[Callable[[int, Draw], Made], int]] = {
    "excited": (excited, 44), "unexcited": (unexcited, 28), "misled": (misled, 30),
}  # fmt: skip
"""The logs that sealed aircraft make, and how many there are in a sealed run."""
COLUMNS = ("logs", "usable", "right", "wrong", "reasons of refusal")
FALSE = {"unexcited": 0, "upset": 0, "misled": 1}
"""The kinds of logs that should not be usable, and how many of a kind may be."""


def rows_of(draw: Draw | None, folder: Path, task: tuple[str, int]) -> list[Row]:
    """Return the row of one log; sealed aircraft fly it if their ``draw`` is given."""
    kind, number = task
    name, make = f"{kind}_{number:03d}", partial(MAKERS[kind], number)
    if draw:
        name, make = f"sealed_{draw.seed}_{name}", partial(SEALED[kind][0], number, draw)
    log, truth = kept(folder, name, make)
    (row,) = (row for row in judged(log, truth, RunConfig()) if row["kind"] == "flight")
    return [row | {"name": name, "log": kind, "group": truth["group"]}]


def off_pct(row: Row) -> float:
    """Return the absolute error of wn in %; infinity without an answer or a truth."""
    error = row.get("wn_error_pct")
    return math.inf if error is None else abs(error)


def cells(rows: Sequence[Row]) -> list[str]:
    """Return the cells of COLUMNS: how many are usable, right and wrong, and what refused."""
    usable = [row for row in rows if row["usable"]]
    right = sum(off_pct(row) < RIGHT_PCT for row in usable)
    wrong = sum(off_pct(row) > WRONG_PCT for row in usable)
    first = Counter((row["fatal"].split() or [NOT_JUDGED])[0] for row in rows if not row["usable"])
    why = ", ".join(f"{reason} {count}" for reason, count in first.most_common())
    return [*map(str, (len(rows), len(usable), right, wrong)), why]


def table(rows: Sequence[Row]) -> Iterator[str]:
    """Yield a table with a row for each kind of log; then the wrong judgements."""
    yield from head("", COLUMNS)
    for kind in dict.fromkeys(row["log"] for row in rows):
        yield line(kind, *cells([row for row in rows if row["log"] == kind]))
    yield ""
    for row in mistakes(rows):
        off = f"wn {row['wn']:.3g}, {off_pct(row):.1f} % off"
        yield f"{row['name']} ({row['group']}) is usable: {off}, warned of {row['warnings'] or '-'}"


def mistakes(rows: Sequence[Row]) -> list[Row]:
    """Return the rows of the usable logs that should not be, or that are wrong."""
    usable = [row for row in rows if row["usable"]]
    return [row for row in usable if row["log"] in FALSE or off_pct(row) > WRONG_PCT]


def missed(rows: Sequence[Row]) -> str | None:
    """Return which kinds of logs are usable, or wrong, too often; None if none is."""
    counts = Counter(row["log"] for row in mistakes(rows))
    bad = [f"{count} {kind}" for kind, count in counts.items() if count > FALSE.get(kind, 0)]
    return f"judged wrongly: {', '.join(bad)}" if bad else None


def main(arguments: list[str]) -> Generator[str, None, str | None]:
    """Yield the table; return which kinds of logs were judged wrongly too often."""
    logs = {"excited": 120, "unexcited": 210, "upset": 0, "misled": 0}
    options = options_of("verdict", __doc__, arguments, **logs, sealed=False, **FLOWN)
    run = begin("verdict") if options.sealed else None
    draw = Draw(run.seed, sealed_places()) if run else None
    counts = {kind: SEALED.get(kind, (None, 0))[1] if run else getattr(options, kind)
              for kind in MAKERS}  # fmt: skip
    tasks = [(kind, i) for kind, count in counts.items() for i in range(count)]
    rows = all_rows(options, partial(rows_of, draw), tasks)
    if run:
        run.note({kind: ", ".join(cells([row for row in rows if row["log"] == kind])[:-1])
                  for kind, count in counts.items() if count})  # fmt: skip
    yield from table(rows)
    return missed(rows)
