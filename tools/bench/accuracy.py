"""Four benches of answers and verdicts, on flights with a known truth.

    python tools/bench.py truth [--seed 162] [--flights N] [--sealed] [--nonlinear] [--logs DIR]
    python tools/bench.py lateral [--seed 913] [--flights N] [--sealed] [--logs DIR]
    python tools/bench.py verdict [--excited 120] [--unexcited 210] [--misled 0]
                                  [--sealed] [--logs DIR]
    python tools/bench.py ordinary [--seed 2000] [--jsbsim 80] [--small 24] [--hostile 110]
                                   [--seconds 900] [--sealed] [--logs DIR]

Each manoeuvre is compared with the truth at the airspeed at which it was flown (checks/judge.py).
A criterion is missed only where its figure misses the limit by more than its own error.
"""

from __future__ import annotations

import math
from argparse import Namespace
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from checks.judge import NOT_JUDGED, OF_BARE, SHOWN, judged, judged_answer, replayed
from flights.fly import Made
from flights.moved import (
    AILERONS,
    GYROS,
    PER_PLACE,
    PER_PLACE_OF_AILERON,
    PLACES,
    RATES_HZ,
    SEVERITIES,
    SHAPES,
    Draw,
    excited,
    of_grid,
    with_aileron,
)
from flights.ordinary import LAWS, Ordinary, fly_ordinary, hostile, jsbsim, small
from flights.plan import Place, sealed_places
from flights.quiet import misled, unexcited

from bench.frame import (
    FAR,
    KEYS,
    METHODS,
    NOT_MET,
    OF_Z,
    Groups,
    Limits,
    Row,
    Truth,
    all_rows,
    cells,
    criteria,
    figures,
    groups,
    note,
    refusals,
    table,
)
from yawid.config.run import RunConfig
from yawid.errors import YawidError

STRIDE = 97
"""Step between the numbers of the flights flown; coprime to their number, so that a few mix all
conditions, except those of --nonlinear, of which there are 96."""
CALM, GUSTY = {"air": "calm"}, {"air": "turbulence"}
LIMITS: Limits = (
    ({}, "wn", "answered %", 79.0),
    (CALM, "wn", "median", 0.75), (CALM, "wn", "RMS", 1.6), (CALM, "wn", "size of the mean", 0.4),
    (CALM, "zeta", "RMS", 0.01), (CALM | {"aircraft": "T38"}, "zeta", "size of the mean", 0.025),
    (GUSTY, "wn", "RMS", 3.1), (GUSTY, "zeta", "RMS", 0.032),
    *(({}, name, "in 2 sigma %", 90.0) for name in SHOWN[:-1]),
    ({}, SHOWN[-1], "z", 1.3), ({}, SHOWN[-1], "median", 5.0),
    ({}, "wn", "beyond", 0.0), ({}, "zeta", "beyond", 0.0),
)  # fmt: skip
"""The criteria of the answers to manoeuvres."""
AIR: Groups = [("{}", "air", ("calm", "turbulence"))]
GROUPS: Groups = [
    ("severity {}", "severity", SEVERITIES[1:]), ("{} gyro", "gyro", GYROS),
    ("{} Hz", "rate_hz", RATES_HZ), ("{}", "manoeuvre", SHAPES), ("{}", "aircraft", ()),
]  # fmt: skip


def flown(
    options: Namespace,
    places: Sequence[Place],
    per_place: int,
    make: Callable[[Draw, int], Made],
    called: str = "",
) -> dict[str, Callable[[], Made]]:
    """Return what makes the flights of a grid that the options ask for, by their names."""
    draw = Draw(options.seed, sealed_places() if options.sealed else places)
    count = per_place * len(draw.places)
    numbers = sorted(i * STRIDE % count for i in range(min(options.flights or count, count)))
    return {f"{called}{draw.seed}_{i:03d}": partial(make, draw, i) for i in numbers}


def answers(log: Path, truth: Truth) -> list[Row]:
    """Return the rows of a flight of the grid, of a replay with the default options."""
    air = {"air": "turbulence" if truth["severity"] else "calm"}
    return [air | row for row in judged(log, truth, responses=True)]


def tables(rows: Sequence[Row]) -> Iterator[Iterable[str]]:
    """Yield the tables of the bench ``truth``, and the answers beyond FAR sigmas, in words."""
    flight, mean = (cells(rows, "flight", end) for end in ("", " of the mean"))
    both = flight | {name: f"{flight[name]}, {mean[name]}" for name in [*flight][-3:]}
    kinds = {"answer": "manoeuvre"} | {method.upper(): method for method in METHODS}
    by_air = {
        f"{title}, {air}": cells(its, kind)
        for (title, kind), (air, its) in product(kinds.items(), groups(rows, AIR).items())
    }
    answers_of_all = {"answer, all": cells(rows, "manoeuvre")}
    yield table("", answers_of_all | by_air | {"flight; then its mean": both})
    across = "answered %", "wn off %, median", "wn RMS", "zeta RMS", "z wn, zeta"
    by_condition = {name: cells(its, "manoeuvre") for name, its in groups(rows, GROUPS).items()}
    yield table("answer", {
        name: {column: of[column] for column in across} for name, of in by_condition.items()
    })  # fmt: skip
    response = {
        f"{name}, {air}": figures(its, "manoeuvre", name)
        for name, (air, its) in product(SHOWN, ({"all": rows} | groups(rows, AIR)).items())
    }
    yield table("response", {
        name: {"answers": f"{of['count']:.0f}"}
        | {each: f"{of[each]:.2f}" for each in ("median", "mean", "z", "in 2 sigma %")}
        for name, of in response.items()
    })  # fmt: skip
    far = (
        "{aircraft}, flight {name}, {manoeuvre}, severity {severity}, {gyro} gyro, {rate_hz} Hz, "
        "at {from_s:.0f} s: {wn_error_pct:+.1f} % ({wn_z:.1f} sigma), zeta {zeta_error:+.3f} "
        "({zeta_z:.1f})"
    ).format
    yield (far(**row) for row in rows if row["kind"] == "manoeuvre" and row["usable"]
           and max(abs(row["wn_z"] or 0.0), abs(row["zeta_z"] or 0.0)) > FAR)  # fmt: skip


def truth(options: Namespace) -> list[Iterable[str]]:
    """Compare estimate and sigma with the truth: the grid of flights/moved.py.

    The tables are of answers and flights, of what ELS and RML of the stream had at each manoeuvre's
    end, of the answer in each condition, and of the response that it gives; then the answers that
    are far off. --sealed flies a quarter of the sealed aircraft's grid, --nonlinear the aircraft
    whose mode depends on the size of the motion.
    """
    if options.sealed and not options.flights:
        options.flights = PER_PLACE * len(sealed_places()) // 4
    rows = all_rows(
        options,
        answers,
        flown(
            options,
            sealed_places(opened=True) if options.nonlinear else PLACES,
            PER_PLACE,
            of_grid,
        ),
    )
    note(options, cells(rows, "manoeuvre"))
    of_flights: Limits = [({}, name, *limit) for name, limit in product(KEYS, OF_Z)]
    return [
        *tables(rows),
        criteria(rows, "manoeuvre", LIMITS, {"all": rows} | groups(rows, [*AIR, *GROUPS])),
        criteria(rows, "flight", of_flights, {}),
    ]


def lateral(options: Namespace) -> list[Iterable[str]]:
    """Compare the bare airframe of flights under a roll hold, which hears the noisy signals.

    The aileron of half of the flights of flights/moved.py is moved, too; that of the others only
    follows the roll hold. The rows of severities and aircraft have a moved aileron. The gates were
    chosen with the seeds 701 and 812.
    """
    found = all_rows(
        options,
        partial(judged, responses=True),
        flown(options, PLACES, PER_PLACE_OF_AILERON, with_aileron, "aileron_"),
    )
    rows = [row for row in found if row["kind"] == "bare"]
    moved = [row for row in rows if row["aileron"] == AILERONS[0]]
    note(options, cells(moved, "bare"))
    shown = groups(rows, [("aileron {}", "aileron", AILERONS)]) | groups(
        moved, [("severity {}", "severity", SEVERITIES[:-1]), ("{}", "aircraft", ())]
    )
    numbers = {name: figures(rows, "bare", name) for name in OF_BARE}
    columns = "count", "median", "z", "in 2 sigma %", "beyond"
    return [
        table("", {name: cells(its, "bare") for name, its in shown.items()}),
        table("number", {
            name: {column: f"{of[column]:.3g}" for column in columns}
            for name, of in numbers.items()
        }),
        criteria(moved, "bare", LIMITS_OF_BARE, shown, names=("wn", "zeta", *OF_BARE)),
    ]  # fmt: skip


LIMITS_OF_BARE: Limits = (
    ({}, "wn", "answered %", 75.0), ({}, "wn", "median", 1.0), ({}, "zeta", "median", 0.008),
    ({}, "roll mode", "median", 4.0),
    *(({}, name, "beyond", 0.0) for name in ("wn", "zeta", *OF_BARE)),
)  # fmt: skip
"""The criteria of the bare airframes of flights whose aileron is moved, too."""
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


def counted(rows: Sequence[Row]) -> dict[str, object]:
    """Return the cells of a kind of logs: how many are usable, right and wrong; what refused."""
    off = [row["off_pct"] for row in rows if row["usable"]]
    return {
        "logs": len(rows), "usable": len(off), "right": sum(each < RIGHT_PCT for each in off),
        "wrong": sum(each > WRONG_PCT for each in off), "reasons of refusal": refusals(rows),
    }  # fmt: skip


def mistakes(rows: Sequence[Row]) -> Iterator[str]:
    """Yield the usable logs that should not be, or that are wrong, and where they are too many."""
    bad = [row for row in rows
           if row["usable"] and (row["log"] in FALSE or row["off_pct"] > WRONG_PCT)]  # fmt: skip
    of = (
        "{name} ({group}) is usable: wn {wn:.3g}, {off_pct:.1f} % off, warned of: {warnings}".format
    )
    yield from (of(**row) for row in bad)
    yield from (f"{NOT_MET}judged wrongly: {count} {kind}"
                for kind, count in Counter(row["log"] for row in bad).items()
                if count > FALSE.get(kind, 0))  # fmt: skip


def verdict(options: Namespace) -> list[Iterable[str]]:
    """Count usable, right and wrong verdicts, on logs with a known answer and on logs without.

    The logs are flights of JSBSim whose rudder is moved on purpose, half of them in turbulence
    (excited), and logs in which nothing excites the Dutch roll (unexcited). There are also flights
    with the rudder of another flight, with their own reversed in time, and with one that is late
    (misled). Below the table are the logs that were judged wrongly; an answer without a wn is
    infinitely far off.
    """
    counts = SEALED if options.sealed else {kind: vars(options)[kind] for kind in MAKERS}
    draws = [Draw(options.seed, sealed_places())] if options.sealed else []
    logs = {"_".join([kind, *(f"{draw.seed}" for draw in draws), f"{number:03d}"]):
            partial(MAKERS[kind], number, *draws)
            for kind, count in counts.items() for number in range(count)}  # fmt: skip
    rows = [
        row | {"off_pct": math.inf if (off := row["wn_error_pct"]) is None else abs(off)}
        for row in all_rows(options, judged, logs) if row["kind"] == "flight"
    ]  # fmt: skip
    found = {kind: counted(its) for kind, its in groups(rows, [("{}", "log", ())]).items()}
    note(options, {kind: ", ".join(map(str, list(of.values())[:-1])) for kind, of in found.items()})
    return [table("", found), mistakes(rows)]


MOST_ZETA, RIGHT_SIGMA = 0.45, 3.0
"""A flight whose zeta is above the first is a hostile log, too. The answer to a hostile log is
right if wn and zeta are both within RIGHT_SIGMA of the bare aircraft's."""
OF_ORDINARY: Limits = (
    ({}, "wn", "answered %", 75.0), ({}, "wn", "RMS", 2.2), ({}, "wn", "worst", 7.0),
    ({}, "wn", "beyond", 0.0), ({}, "zeta", "RMS", 0.025), ({}, "zeta", "beyond", 0.0),
)  # fmt: skip
"""The criteria of the answers, of wn in %; figures have no error of their own here."""
ORDINARY: Groups = [
    ("JSBSim", "log", ("jsbsim",)), ("severity {}", "severity", SEVERITIES),
    ("{} Hz", "rate_hz", RATES_HZ), ("{}", "rudder", ("mixed", "resting")), ("{}", "law", LAWS),
    ("frozen field", "frozen", (True,)), ("{}", "aircraft", ()),
]  # fmt: skip


def made(kind: Callable[..., Ordinary], *drawn: Any) -> Made:
    """Fly a flight of a kind, as drawn."""
    return fly_ordinary(kind(*drawn))


def ordinary_rows(log: Path, truth: Truth) -> list[Row]:
    """Return the row of a log, answered as an ordinary flight."""
    row: Row = {"kind": "ordinary"}
    true, roll, verdict = None, None, NOT_JUDGED
    if mode := truth["dutch_roll_open_loop"]:
        true = np.array([mode["wn_rad_s"], mode["zeta"]]), np.zeros(2)
        row |= {"family": f"zeta above {MOST_ZETA:g}"} if mode["zeta"] > MOST_ZETA else {}
    try:
        if (found := replayed(log, RunConfig(ordinary="only")).ordinary) is not None:
            roll, verdict = found.dutch_roll, found.verdict
    except YawidError as error:
        return [row | judged_answer(None, true, NOT_JUDGED) | {"fatal": type(error).__name__}]
    return [row | judged_answer(roll, true, verdict)]


def of_ordinary(rows: Sequence[Row]) -> dict[str, str]:
    """Return the cells of some ordinary flights by column."""
    wn, zeta = (figures(rows, "ordinary", name) for name in ("wn", "zeta"))
    return {
        "flights": f"{len(rows)}", "answered %": f"{wn['answered %']:.0f}",
        "wn %": f"{wn['median']:.2f}", "RMS": f"{wn['RMS']:.2f}",
        "zeta RMS": f"{zeta['RMS']:.4f}", "worst": f"{wn['worst']:.1f} {zeta['worst']:.3f}",
        "z": f"{wn['z']:.2f} {zeta['z']:.2f}",
        "in 2 sigma %": f"{wn['in 2 sigma %']:.0f} {zeta['in 2 sigma %']:.0f}",
        f"beyond {FAR:g}": f"{wn['beyond'] + zeta['beyond']:.0f}",
    }  # fmt: skip


def is_wrong(row: Row) -> bool:
    """Return whether a hostile log is usable and its answer is not the bare aircraft's."""
    return bool(row["usable"]) and not all(
        z is not None and abs(z) <= RIGHT_SIGMA for z in (row["wn_z"], row["zeta_z"])
    )


def against_us(rows: Sequence[Row]) -> dict[str, object]:
    """Return the cells of some hostile logs by column."""
    usable, wrong = sum(row["usable"] for row in rows), sum(map(is_wrong, rows))
    return {
        "logs": len(rows), "refused": len(rows) - usable, "right": usable - wrong, "wrong": wrong,
        "reasons of refusal": refusals(rows),
    }  # fmt: skip


def ordinary(options: Namespace) -> list[Iterable[str]]:
    """Compare the answers to ordinary flights with the truth; count wrong ones to hostile logs.

    The flights are those of flights/ordinary.py: ten aircraft of JSBSim's at severity 0 to 3,
    and small linear ones of 3 to 12 rad/s. A sealed run has ``--jsbsim`` flights. A criterion holds
    for all flights or, of z and the share in 2 sigma, for each row of LEAST_ROW answers.
    """
    seed, s = options.seed, options.seconds
    makers = {
        "jsbsim": partial(made, jsbsim, seed), "small": partial(made, small, seed),
        "hostile": partial(hostile, seed + 3000),
    }  # fmt: skip
    places = [sealed_places()] if options.sealed else []
    logs = {f"{log}_{seed}_{i:03d}_{s:.0f}s": partial(makers[log], i, s, *places)
            for log in (["jsbsim"] if places else makers)
            for i in range(vars(options)[log])}  # fmt: skip
    rows = all_rows(options, ordinary_rows, logs)
    flights, hostile_logs = ([row for row in rows if ("family" in row) == is_hostile]
                             for is_hostile in (False, True))  # fmt: skip
    note(options, of_ordinary(flights))
    some = {"all": flights} | groups(flights, ORDINARY)
    wrong = "{family}, {name}: wn {wn:.3g}, zeta {zeta:.3f}".format
    return [
        table("", {name: of_ordinary(its) for name, its in some.items()}),
        table(
            "hostile logs",
            {
                name: against_us(its)
                for name, its in groups(hostile_logs, [("{}", "family", ())]).items()
            },
        ),
        criteria(flights, "ordinary", OF_ORDINARY, some, draws=1),
        (f"{NOT_MET}wrong: {wrong(**row)}" for row in filter(is_wrong, hostile_logs)),
    ]
