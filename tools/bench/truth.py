"""Two benches of accuracy: flights of JSBSim in all conditions, against their linearisation.

    python tools/bench.py truth [--seed 162] [--flights N] [--sealed] [--nonlinear] [--logs DIR]
    python tools/bench.py lateral [--seed 913] [--flights N] [--sealed] [--logs DIR]

Each manoeuvre is compared with the truth at the airspeed at which it was flown (checks/judge.py).
A criterion is missed only where its figure misses the limit by more than its own error.
"""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Iterator, Sequence
from functools import partial
from itertools import product
from pathlib import Path

import numpy as np
from checks.judge import SHOWN, against, judged
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
    of_grid,
    with_aileron,
)
from flights.plan import nonlinear_places, sealed_places

from bench.frame import (
    FAR,
    FIGURES,
    KEYS,
    METHODS,
    OF_Z,
    Groups,
    Row,
    Truth,
    all_rows,
    cells,
    errors,
    estimates,
    groups,
    missed,
    note,
    rows_missed,
    table,
)
from yawid.config.run import RunConfig

STRIDE = 97
"""Step between the numbers of the flights flown; coprime to their number, so that a few mix all
conditions, except those of --nonlinear, of which there are 96."""
ANSWERED_PCT = 79.0
CALM, GUSTY = {"air": "calm"}, {"air": "turbulence"}
LIMITS: tuple[tuple[dict[str, str], str, str, float], ...] = (
    (CALM, "wn", "median", 0.75), (CALM, "wn", "RMS", 1.6), (CALM, "wn", "size of the mean", 0.4),
    (CALM, "zeta", "RMS", 0.01), (CALM | {"aircraft": "T38"}, "zeta", "size of the mean", 0.025),
    (GUSTY, "wn", "RMS", 3.1), (GUSTY, "zeta", "RMS", 0.032),
    *(({}, name, "in 2 sigma %", 90.0) for name in SHOWN[:-1]),
    ({}, SHOWN[-1], "z", 1.3), ({}, SHOWN[-1], "median", 5.0),
)  # fmt: skip
"""The criteria of the answers to manoeuvres: conditions, number, figure, and its limit."""
ACROSS = ("answered %", "wn off %, median", "wn RMS", "zeta RMS", "z wn, zeta")
"""The columns that are shown for each condition."""
AIR: Groups = [("{}", "air", ("calm", "turbulence"))]
GROUPS: Groups = [
    ("severity {}", "severity", SEVERITIES[1:]), ("{} gyro", "gyro", GYROS),
    ("{} Hz", "rate_hz", RATES_HZ), ("{}", "manoeuvre", SHAPES), ("{}", "aircraft", ()),
]  # fmt: skip


def answers(log: Path, truth: Truth) -> list[Row]:
    """Return the rows of a flight of the grid, of a replay with the default options."""
    names = "aircraft", "manoeuvre", "severity", "gyro", "rate_hz"
    facts = {name: truth[name] for name in names}
    facts["air"] = "turbulence" if truth["severity"] else "calm"
    return [facts | against(row, truth) for row in judged(log, truth)]


def air_lines(rows: Sequence[Row]) -> Iterator[str]:
    """Yield the table of answers, ELS, RML and flights by the air."""
    flight, mean = (cells(rows, "flight", end) for end in ("", " of the mean"))
    both = {name: f"{flight[name]}, {mean[name]}" for name in list(flight)[-3:]}
    kinds = {"answer": "manoeuvre"} | {method.upper(): method for method in METHODS}
    by_air = (
        (f"{title}, {air}", cells(its, kind))
        for (title, kind), (air, its) in product(kinds.items(), groups(rows, AIR))
    )
    all_answers = "answer, all", cells(rows, "manoeuvre")
    yield from table("", [all_answers, *by_air, ("flight; then its mean", flight | both)])


def condition_lines(rows: Sequence[Row]) -> Iterator[str]:
    """Yield the table of the answer in each condition, and of each aircraft."""
    by_name = ((name, cells(its, "manoeuvre")) for name, its in groups(rows, GROUPS))
    yield from table("answer", ((name, {column: of[column] for column in ACROSS})
                                for name, of in by_name))  # fmt: skip


def response_lines(rows: Sequence[Row]) -> Iterator[str]:
    """Yield the table of the response that the answer gives, by the air."""
    figures = ("median", "mean", "z", "in 2 sigma %")
    by_air = product(SHOWN, [("all", rows), *groups(rows, AIR)])
    found = ((f"{name}, {air}", errors(its, "manoeuvre", name)) for name, (air, its) in by_air)
    yield from table("response", (
        (name, {"answers": len(of)} | {each: f"{FIGURES[each](of):.2f}" for each in figures})
        for name, of in found
    ))  # fmt: skip


def far_lines(rows: Sequence[Row]) -> Iterator[str]:
    """Yield the answers beyond FAR sigmas, in words."""
    for row in estimates(rows, "manoeuvre"):
        if max(abs(row["wn_z"]), abs(row["zeta_z"])) > FAR:
            where = "{aircraft}, flight {name}, {manoeuvre}, severity {severity}, {gyro} gyro, "
            off = "{rate_hz} Hz, at {from_s:.0f} s: {wn_error_pct:+.1f} % ({wn_z:.1f} sigma), "
            yield (where + off + "zeta {zeta_error:+.3f} ({zeta_z:.1f})").format(**row)


def criteria(rows: Sequence[Row]) -> Iterator[str]:
    """Yield the criteria that are missed."""
    found = [row for row in rows if row["kind"] == "manoeuvre"]
    usable = [(row["number"], 100.0 * row["usable"], 0.0) for row in found]
    yield from missed("answered %", "mean", np.array(usable).reshape(-1, 3), ANSWERED_PCT)
    for where, name, figure, limit in LIMITS:
        if its := [row for row in found if where.items() <= row.items()]:
            what = ", ".join([name, *where.values()])
            yield from missed(what, figure, errors(its, "manoeuvre", name), limit)
    yield from rows_missed([("all", found), *groups(found, [*AIR, *GROUPS])], "manoeuvre")
    for name in ("wn", "zeta"):
        yield from missed(name, "beyond", errors(found, "manoeuvre", name), 0.0, draws=0)
    for name, (figure, limit) in product(KEYS, OF_Z):
        yield from missed(f"flight, {name}", figure, errors(rows, "flight", name), limit)


def truth(options: Namespace) -> Iterator[str]:
    """Compare estimate and sigma with the truth: the grid of flights/moved.py.

    The tables are of answers and flights, of what ELS and RML of the stream had at each manoeuvre's
    end, of the answer in each condition, and of the response that it gives; then the answers that
    are far off. --sealed flies the sealed aircraft, --nonlinear those whose mode depends on the
    size of the motion.
    """
    own_places = nonlinear_places() if options.nonlinear else PLACES
    draw = Draw(options.seed, sealed_places() if options.sealed else own_places)
    count = PER_PLACE * len(draw.places)
    flights = min(options.flights or (count // 4 if options.sealed else count), count)
    numbers = sorted(i * STRIDE % count for i in range(flights))
    logs = {f"{draw.seed}_{number:03d}": partial(of_grid, draw, number) for number in numbers}
    rows = all_rows(options, answers, logs)
    note(options, cells(rows, "manoeuvre"))
    for lines in (air_lines, condition_lines, response_lines, far_lines, criteria):
        yield from lines(rows)
        yield ""


def airframes(log: Path, truth: Truth) -> list[Row]:
    """Return the rows of the bare airframe of a flight, of a replay with ``--lateral auto``."""
    facts = {name: truth[name] for name in ("aircraft", "severity", "aileron")}
    rows = judged(log, truth, RunConfig(lateral="auto"))
    return [facts | row for row in rows if row["kind"] == "bare"]


def lateral(options: Namespace) -> Iterator[str]:
    """Compare the bare airframe of flights under a roll hold, which hears the noisy signals.

    The aileron of half of the flights of flights/moved.py is moved, too; that of the others only
    follows the roll hold. The rows of severities and aircraft have a moved aileron. The gates were
    chosen with the seeds 701 and 812.
    """
    draw = Draw(options.seed, sealed_places() if options.sealed else PLACES)
    count = PER_PLACE_OF_AILERON * len(draw.places)
    numbers = [i * STRIDE % count for i in range(options.flights or count)]
    logs = {f"aileron_{draw.seed}_{i:03d}": partial(with_aileron, draw, i) for i in numbers}
    rows = all_rows(options, airframes, logs)
    moved = [row for row in rows if row["aileron"] == AILERONS[0]]
    note(options, cells(moved, "bare"))
    found = [
        *groups(rows, [("aileron {}", "aileron", AILERONS)]),
        *groups(moved, [("severity {}", "severity", SEVERITIES[:-1]), ("{}", "aircraft", ())]),
    ]
    yield from table("", ((name, cells(its, "bare")) for name, its in found))
    yield ""
    yield from rows_missed([("aileron moved", moved)], "bare")
