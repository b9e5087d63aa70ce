"""Two benches of judgement: how often a verdict errs, and how good ordinary flights' answers are.

python tools/bench.py verdict [--excited 120] [--unexcited 210] [--misled 0]
                              [--sealed] [--logs DIR]
python tools/bench.py ordinary [--seed 2000] [--jsbsim 80] [--small 24] [--hostile 110]
                               [--seconds 900] [--sealed] [--logs DIR]
"""

from __future__ import annotations

import math
from argparse import Namespace
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from checks.judge import NOT_JUDGED, judged, judged_answer, replayed
from flights.fly import Made
from flights.moved import RATES_HZ, SEVERITIES, Draw, excited
from flights.ordinary import LAWS, Ordinary, fly_ordinary, hostile, jsbsim, small
from flights.plan import sealed_places
from flights.quiet import misled, unexcited

from bench.frame import (
    FAR,
    FIGURES,
    NOT_MET,
    Groups,
    Row,
    Truth,
    all_rows,
    cells,
    errors,
    groups,
    missed,
    note,
    refusals,
    rows_missed,
    table,
)
from yawid.answers.ordinary import OrdinaryAnswer
from yawid.config.run import RunConfig
from yawid.errors import YawidError

SEALED = {"excited": 44, "unexcited": 28, "misled": 30}
"""How many logs there are in a sealed run."""
RIGHT_PCT, WRONG_PCT = 5.0, 10.0
"""Limits of wn's error in %: an answer below the first is right, one above the second is wrong."""
FALSE = {"unexcited": 0, "misled": 1}
"""The kinds of logs that should not be usable, and how many of a kind may be."""


MAKERS: dict[str, Callable[..., Made]] = {
    "excited": excited, "unexcited": unexcited, "misled": misled,
}  # fmt: skip
"""What makes a log of its number, and of the draw of a sealed run."""


def whole(log: Path, truth: Truth) -> list[Row]:
    """Return the row of a log, with the size of wn's error: infinite without an answer."""
    *_, row = judged(log, truth)
    off_pct = math.inf if row["wn_error_pct"] is None else abs(row["wn_error_pct"])
    return [row | {"group": truth["group"], "off_pct": off_pct}]


def counted(rows: Sequence[Row]) -> dict[str, object]:
    """Return the cells of a kind of logs: how many are usable, right and wrong; what refused."""
    off = [row["off_pct"] for row in rows if row["usable"]]
    right, wrong = sum(each < RIGHT_PCT for each in off), sum(each > WRONG_PCT for each in off)
    numbers = {"logs": len(rows), "usable": len(off), "right": right, "wrong": wrong}
    return numbers | {"reasons of refusal": refusals(rows)}


def mistakes(rows: Sequence[Row]) -> Iterator[str]:
    """Yield the usable logs that should not be, or that are wrong, and where they are too many."""
    bad = [row for row in rows
           if row["usable"] and (row["log"] in FALSE or row["off_pct"] > WRONG_PCT)]  # fmt: skip
    for row in bad:
        off = f"wn {row['wn']:.3g}, {row['off_pct']:.1f} % off"
        yield f"{row['name']} ({row['group']}) is usable: {off}, warned of {row['warnings'] or '-'}"
    for kind, count in Counter(row["log"] for row in bad).items():
        if count > FALSE.get(kind, 0):
            yield f"{NOT_MET}judged wrongly: {count} {kind}"


def verdict(options: Namespace) -> Iterator[str]:
    """Count usable, right and wrong verdicts, on logs with a known answer and on logs without.

    The logs are flights of JSBSim whose rudder is moved on purpose, half of them in turbulence
    (excited), and logs in which nothing excites the Dutch roll (unexcited). There are also flights
    with the rudder of another flight, with their own reversed in time, and with one that is late
    (misled). Below the table are the logs that were judged wrongly.
    """
    counts = SEALED if options.sealed else {kind: vars(options)[kind] for kind in MAKERS}
    draws = [Draw(options.seed, sealed_places())] if options.sealed else []
    seeds = "".join(f"{draw.seed}_" for draw in draws)
    logs = {f"{kind}_{seeds}{number:03d}": partial(MAKERS[kind], number, *draws)
            for kind, count in counts.items() for number in range(count)}  # fmt: skip
    rows = all_rows(options, whole, logs)
    found = {kind: counted(its) for kind, its in groups(rows, [("{}", "log", ())])}
    note(options, {kind: ", ".join(map(str, list(of.values())[:-1])) for kind, of in found.items()})
    yield from table("", found.items())
    yield ""
    yield from mistakes(rows)


HOSTILE_SEED = 3000
"""What the seed of the hostile logs is larger by."""
MOST_ZETA, RIGHT_SIGMA = 0.45, 3.0
"""A flight whose zeta is above the first is a hostile log, too. The answer to a hostile log is
right if wn and zeta are both within RIGHT_SIGMA of the bare aircraft's."""
ANSWERED_PCT = 75.0
LIMITS = {
    ("wn", "RMS"): 2.2, ("wn", "worst"): 7.0, ("wn", "beyond"): 0.0,
    ("zeta", "RMS"): 0.025, ("zeta", "beyond"): 0.0,
}  # fmt: skip
"""The most of a figure of wn in % and of zeta, of all answers."""
GROUPS: Groups = [
    ("JSBSim", "log", ("jsbsim",)), ("severity {}", "severity", SEVERITIES),
    ("{} Hz", "rate_hz", RATES_HZ), ("{}", "rudder", ("mixed", "resting")), ("{}", "law", LAWS),
    ("frozen field", "frozen", (True,)), ("{}", "aircraft", ()),
]  # fmt: skip


def made(kind: Callable[..., Ordinary], *drawn: Any) -> Made:
    """Fly a flight of a kind, as drawn."""
    return fly_ordinary(kind(*drawn))


def ordinary_rows(log: Path, truth: Truth) -> list[Row]:
    """Return the row of a log, answered as an ordinary flight."""
    mode = truth.pop("dutch_roll_open_loop")
    true = mode and (np.array([mode["wn_rad_s"], mode["zeta"]]), np.zeros(2))
    if mode and mode["zeta"] > MOST_ZETA:
        truth["family"] = f"zeta above {MOST_ZETA:g}"
    try:
        found = replayed(log, RunConfig(ordinary="only")).ordinary
        if found is None:  # an answer that is not usable is false
            found = OrdinaryAnswer(verdict=NOT_JUDGED)
        row = judged_answer(found.dutch_roll, true, found.verdict)
    except YawidError as error:
        row = judged_answer(None, None, NOT_JUDGED) | {"fatal": type(error).__name__}
    return [truth | {"kind": "ordinary"} | row]


def shown(rows: Sequence[Row]) -> dict[str, str]:
    """Return the cells of some ordinary flights by column."""
    of = cells(rows, "ordinary")
    wn, zeta = (FIGURES["worst"](errors(rows, "ordinary", name)) for name in ("wn", "zeta"))
    return {
        "flights": str(len(rows)), "answered %": of["answered %"], "wn %": of["wn off %, median"],
        "RMS": of["wn RMS"], "zeta RMS": of["zeta RMS"], "worst": f"{wn:.1f} {zeta:.3f}",
        "z": of["z wn, zeta"], "in 2 sigma %": of["in 2 sigma %"],
        f"beyond {FAR:g}": of[f"beyond {FAR:g}"],
    }  # fmt: skip


def is_wrong(row: Row) -> bool:
    """Return whether a hostile log is usable and its answer is not the bare aircraft's."""
    z = row["wn_z"], row["zeta_z"]
    return bool(row["usable"]) and (None in z or max(map(abs, z)) > RIGHT_SIGMA)


def against_us(rows: Sequence[Row]) -> dict[str, object]:
    """Return the cells of some hostile logs by column."""
    usable, wrong = sum(row["usable"] for row in rows), sum(map(is_wrong, rows))
    return {
        "logs": len(rows), "refused": len(rows) - usable, "right": usable - wrong, "wrong": wrong,
        "reasons of refusal": refusals(rows),
    }  # fmt: skip


def criteria(flights: Sequence[Row], hostile_logs: Sequence[Row]) -> Iterator[str]:
    """Yield the criteria that are missed; figures have no error of their own here."""
    usable = [(row["number"], 100.0 * row["usable"], 0.0) for row in flights]
    yield from missed("answered %", "mean", np.array(usable).reshape(-1, 3), ANSWERED_PCT, draws=0)
    for (name, figure), limit in LIMITS.items():
        yield from missed(name, figure, errors(flights, "ordinary", name), limit, draws=0)
    yield from rows_missed([("all", flights), *groups(flights, GROUPS)], "ordinary", draws=0)
    for row in filter(is_wrong, hostile_logs):
        off = f"wn {row['wn']:.3g}, zeta {row['zeta']:.3f}"
        yield f"{NOT_MET}wrong: {row['family']}, {row['name']}: {off}"


def ordinary(options: Namespace) -> Iterator[str]:
    """Compare the answers to ordinary flights with the truth; count wrong ones to hostile logs.

    The flights are those of flights/ordinary.py: ten aircraft of JSBSim's at severity 0 to 3,
    and small linear ones of 3 to 12 rad/s. A sealed run has ``--jsbsim`` flights. A criterion holds
    for all flights or, of z and the share in 2 sigma, for each row of LEAST_ROW answers.
    """
    seed, s = options.seed, options.seconds
    makers = {
        "jsbsim": partial(made, jsbsim, seed), "small": partial(made, small, seed),
        "hostile": partial(hostile, seed + HOSTILE_SEED),
    }  # fmt: skip
    places = [sealed_places()] if options.sealed else []
    logs = {f"{log}_{seed}_{i:03d}_{s:.0f}s": partial(makers[log], i, s, *places)
            for log in (["jsbsim"] if places else makers)
            for i in range(vars(options)[log])}  # fmt: skip
    rows = all_rows(options, ordinary_rows, logs)
    flights, hostile_logs = ([row for row in rows if ("family" in row) == is_hostile]
                             for is_hostile in (False, True))  # fmt: skip
    note(options, shown(flights))
    yield from table("", (
        (name, shown(its)) for name, its in [("all", flights), *groups(flights, GROUPS)]
    ))  # fmt: skip
    yield ""
    yield from table("hostile logs", (
        (family, against_us(its)) for family, its in groups(hostile_logs, [("{}", "family", ())])
    ))  # fmt: skip
    yield ""
    yield from criteria(flights, hostile_logs)
