"""Compares the answers to ordinary flights with the truth, and counts false ones to hostile logs.

    python tools/bench.py ordinary [--seed 2000] [--jsbsim 80] [--small 24] [--hostile 110]
                                   [--seconds 900] [--sealed] [--logs DIR] [--jobs 2] [--csv FILE]
                                   [--readme]

The flights are those of flights/ordinary.py: ten aircraft of JSBSim's at severity 0 to 3, and
small linear ones of 3 to 12 rad/s; z is (estimate - truth) / sigma. The hostile logs have the seed
plus 3000. A flight whose zeta is above MOST_ZETA is a hostile log, too. The answer to a hostile log
is right if wn and zeta are both within RIGHT_SIGMA of the bare aircraft's. With --sealed the sealed
aircraft fly (bench/frame.py), ``--jsbsim`` flights of them. The exit code is 1 if a criterion is
not met: it holds for all flights or, of z and the share in 2 sigma, for each row of LEAST_ROW
answers.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Generator, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from checks.judge import Row, judged_answer, kept, replayed
from flights.fly import Made
from flights.moved import RATES_HZ, SEVERITIES
from flights.ordinary import LAWS, SECONDS, fly_ordinary, hostile, jsbsim, small
from flights.plan import sealed_places

from bench.frame import FLOWN, all_rows, begin, head, known, line, options_of, rms, within
from bench.truth import COLUMNS as FIGURES
from bench.truth import FAR, IN_2_PCT, LEAST_ROW, MOST_Z, cells, errors, estimates
from yawid.answers.ordinary import OrdinaryAnswer
from yawid.answers.reasons import Verdict
from yawid.config.run import RunConfig
from yawid.errors import YawidError

SEED, HOSTILE_SEED = 2000, 3000
MOST_ZETA, RIGHT_SIGMA = 0.45, 3.0
KIND = "ordinary"
"""The kind of these rows among those of checks/judge.py."""
LIMITS = (("wn", 2.2, 7.0), ("zeta", 0.025, math.inf))
"""The most of RMS and of any error, of wn in % and of zeta; at least 75 % should be answered."""
MAKERS: dict[str, Callable[[int, int, float], Made]] = {
    "JSBSim": lambda seed, number, s: fly_ordinary(jsbsim(seed, number, s)),
    "small": lambda seed, number, s: fly_ordinary(small(seed, number, s)),
    "hostile": lambda seed, number, s: hostile(seed + HOSTILE_SEED, number, s),
    "sealed": lambda seed, number, s: fly_ordinary(jsbsim(seed, number, s, sealed_places())),
}
GROUPS: dict[str, tuple[str, object]] = {
    "JSBSim": ("log", "JSBSim"),
    **{f"severity {severity}": ("severity", severity) for severity in SEVERITIES},
    **{f"{hz} Hz": ("rate_hz", hz) for hz in RATES_HZ}, "mixed": ("rudder", "mixed"),
    "resting": ("rudder", "resting"), **{law: ("law", law) for law in LAWS},
    "frozen field": ("frozen", True),
}  # fmt: skip
"""The conditions that have a row: what they are called, and what their flights have. Each aircraft
has a row, too."""
Rows = Sequence[Row]


def ordinary_of_log(path: Path) -> OrdinaryAnswer:
    """Return what a log answers as an ordinary flight."""
    found = replayed(path, RunConfig(ordinary="only")).ordinary
    return OrdinaryAnswer(verdict=Verdict(usable=False, reasons=[])) if found is None else found


def rows_of(seed: int, seconds: float, folder: Path, task: tuple[str, int]) -> list[Row]:
    """Fly, or take from the folder, and answer; return the log's row."""
    log, number = task
    name = f"{log}_{seed}_{number:03d}_{seconds:.0f}s"
    path, truth = kept(folder, name, partial(MAKERS[log], seed, number, seconds))
    mode = truth.pop("dutch_roll_open_loop")
    true = mode and (np.array([mode["wn_rad_s"], mode["zeta"]]), np.zeros(2))
    try:
        found = ordinary_of_log(path)
        row = judged_answer(found.dutch_roll, true, found.verdict)
    except YawidError as error:
        row = judged_answer(None, None, Verdict(usable=False, reasons=[]))
        row["fatal"] = type(error).__name__
    if mode and mode["zeta"] > MOST_ZETA:
        truth |= {"family": f"zeta above {MOST_ZETA:g}"}
    return [truth | {"kind": KIND, "log": log, "number": number} | row]


def groups(rows: Rows) -> Iterator[tuple[str, Rows]]:
    """Yield the names of all rows of the table, and the flights of each."""
    yield "all", rows
    aircraft = {row["aircraft"]: ("aircraft", row["aircraft"]) for row in rows}
    for title, (name, value) in (GROUPS | aircraft).items():
        if its := [row for row in rows if row[name] == value]:
            yield title, its


def shown(rows: Rows) -> dict[str, str]:
    """Return the cells of a row by name; the figures of errors are those of bench/truth.py."""
    by_name = dict(zip(FIGURES, cells(rows, KIND), strict=True))
    off = [np.abs(errors(estimates(rows, KIND), name)[:, 1]) for name in ("wn", "zeta")]
    return {
        "flights": str(len(rows)), "answered %": by_name["answered %"],
        "wn %": by_name["wn off %, median"], "RMS": by_name["wn RMS"],
        "zeta RMS": by_name["zeta RMS"],
        "worst": "{:.1f} {:.3f}".format(*(known(np.max, x) for x in off)),
        "z": by_name["z wn, zeta"], "in 2 sigma %": by_name["in 2 sigma %"],
        f"beyond {FAR:g}": by_name[f"beyond {FAR:g}"],
    }  # fmt: skip


def flight_lines(rows: Rows) -> Iterator[str]:
    """Yield the table of ordinary flights."""
    yield from head("", shown(rows))
    for name, its in groups(rows):
        yield line(name, *shown(its).values())


def is_wrong(row: Row) -> bool:
    """Return whether a hostile log is usable and its answer is not the bare aircraft's."""
    z = row["wn_z"], row["zeta_z"]
    return bool(row["usable"]) and (None in z or max(map(abs, z)) > RIGHT_SIGMA)


def hostile_lines(rows: Rows) -> Iterator[str]:
    """Yield the table of hostile logs, a blank line, and the wrong answers."""
    yield from head("hostile logs", ("logs", "refused", "right", "wrong", "reasons of refusal"))
    for family in dict.fromkeys(row["family"] for row in rows):
        its = [row for row in rows if row["family"] == family]
        first = Counter(row["fatal"].split()[0] for row in its if not row["usable"])
        refused, wrong = first.total(), sum(map(is_wrong, its))
        why = ", ".join(f"{reason} {count}" for reason, count in first.most_common())
        yield line(family, len(its), refused, len(its) - refused - wrong, wrong, why)
    yield ""
    for row in filter(is_wrong, rows):
        off = f"wn {row['wn']:.3g}, zeta {row['zeta']:.3f}"
        yield f"wrong: {row['family']}, {row['log']} {row['number']}: {off}"


def missed(flights: Rows, against: Rows) -> list[str]:
    """Return which criteria are not met."""
    figures = {"% refused": (100.0 - 100.0 * np.mean([row["usable"] for row in flights]), 25.0)}
    figures["false answers"] = sum(map(is_wrong, against)), 0.0
    for name, most_rms, most in LIMITS:
        for group, its in groups(flights):
            off, z = np.abs(errors(estimates(its, KIND), name)[:, 1:].T)
            if group == "all":
                figures[f"RMS of {name}"] = rms(off), most_rms
                figures[f"{name} off by"] = off.max(initial=0.0), most
                figures[f"z of {name} up to"] = z.max(initial=0.0), FAR
            if len(z) >= LEAST_ROW:
                figures[f"z of {name}, {group}"] = rms(z), MOST_Z
                figures[f"% of {name} in 2 sigma, {group}"] = -within(z), -IN_2_PCT
    return [f"{name} {value:.3g}" for name, (value, limit) in figures.items() if value > limit]


def main(arguments: list[str]) -> Generator[str, None, str | None]:
    """Yield the tables; return which criteria are not met."""
    own: dict[str, Any] = {"seed": SEED, "jsbsim": 80, "small": 24, "hostile": 110}
    options = options_of(
        "ordinary", __doc__, arguments, **own, seconds=SECONDS, sealed=False, **FLOWN
    )
    run = begin("ordinary") if options.sealed else None
    counts = (
        (0, 0, 0, options.jsbsim) if run else (options.jsbsim, options.small, options.hostile, 0)
    )
    tasks = [(log, i) for log, count in zip(MAKERS, counts, strict=True) for i in range(count)]
    seed = run.seed if run else options.seed
    rows = all_rows(options, partial(rows_of, seed, options.seconds), tasks)
    flights, against = [r for r in rows if "family" not in r], [r for r in rows if "family" in r]
    if run:
        run.note(shown(flights))
    yield from flight_lines(flights)
    yield ""
    yield from hostile_lines(against)
    failed = missed(flights, against)
    return f"not met: {'; '.join(failed)}" if failed else None
