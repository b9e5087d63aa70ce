"""One frame for all benches: options, rows of flights, errors in sigma, tables, sealed runs.

    python tools/bench.py NAME [options] [--readme]

A bench is a function of the options named in BENCHES. It returns blocks of lines, between which a
blank line is printed: one or more Markdown tables, and then what else it found. A line that begins
with NOT_MET names an aim that was missed: the exit code is 1 then. With ``--readme`` the first
tables are also written to tools/README.md, below their markers: see ``PLACES``.

Flights stay in the folder of --logs, and are not flown again; --jobs 1 flies them in this process.

A run on the sealed aircraft belongs to a commit, whose hash gives its seed: one run of each bench
for a commit, with all changes committed. Its figures are a row of flights/sealed.csv, which is
never edited by hand.

In all tables, z is (estimate - truth) / sqrt(sigma^2 + sigma of the truth^2). Estimates that count
are the usable ones; of the recursive methods they are all that have a number.
"""

from __future__ import annotations

import argparse
import datetime
import importlib
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from itertools import count, product
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
from checks.readme_tables import put
from numpy.typing import NDArray

Row = dict[str, Any]
"""What is known of one estimate, by name."""
Truth = dict[str, Any]
Floats = NDArray[np.float64]
FLOWN = {"sealed": False, "logs": "", "jobs": 2}
BENCHES: dict[str, tuple[str, dict[str, Any]]] = {
    "truth": ("accuracy", {"seed": 162, "flights": 0, "nonlinear": False} | FLOWN),
    "lateral": ("accuracy", {"seed": 913, "flights": 0} | FLOWN),
    "verdict": ("accuracy", {"excited": 120, "unexcited": 210, "misled": 0} | FLOWN),
    "ordinary": ("accuracy", FLOWN | {
        "seed": 2000, "jsbsim": 80, "small": 24, "hostile": 110, "seconds": 900.0,
    }),
    "damper": ("damper", {"cases": 100} | FLOWN),
    "estimator": ("speed", {"rounds": 60}),
    "link": ("speed", {}),
    "start": ("programs", {"rounds": 5}),
    "live": ("programs", {}),
    "fleet": ("programs", {"count": 2000, "workers": 2}),
    "serve": ("programs", {"rounds": 3, "count": 1000}),
}  # fmt: skip
"""The module of each bench, and its options with their defaults; False is a flag."""
PLACES = {
    "truth": ["truth", "truth_by"],
    "lateral": ["lateral", "lateral_numbers"],
    "ordinary": ["ordinary", "ordinary_hostile"],
    "start": ["start", "start_bare"],
}
"""The markers of a bench's tables. A bench that is not here writes its first table, below the
marker of its own name."""
NOT_MET = "not met: "
ROOT = Path(__file__).resolve().parents[2]
FILE = Path("tools", "flights", "sealed.csv")


def main(arguments: list[str]) -> int:
    """Run the bench named first with the options that follow; return 1 if it missed an aim.

    The first cell of the first header, which a bench leaves empty, gets the command and the date;
    a path in it is replaced by LOG.
    """
    options = options_of(arguments)
    bench = getattr(importlib.import_module(f"bench.{BENCHES[options.bench][0]}"), options.bench)
    shown = ["LOG" if "/" in each else each for each in arguments if each != "--readme"]
    blocks = ["\n".join(lines) for lines in bench(options)]
    blocks[0] = blocks[0].replace("|  |", f"| `{' '.join(shown)}`, {options.date} |", 1)
    print("\n\n".join(filter(None, blocks)))
    if options.readme:
        own = [f"{options.bench}_{kind}" for kind in ("sealed", "nonlinear")
               if getattr(options, kind, False)]  # fmt: skip
        places = own or PLACES.get(options.bench, [options.bench])
        for place, made in zip(
            places, [each for each in blocks if each.startswith("|")], strict=False
        ):
            put(place, made)
    return int(any(NOT_MET in block for block in blocks))


def options_of(arguments: Sequence[str]) -> argparse.Namespace:
    """Return the options of the bench named first, and the date in UTC.

    A sealed run also has its commit, and the seed of that.
    """
    parser = argparse.ArgumentParser(prog="bench.py")
    benches = parser.add_subparsers(dest="bench", required=True)
    for bench, (_, defaults) in BENCHES.items():
        own = benches.add_parser(bench)
        for name, default in (defaults | {"readme": False}).items():
            how: dict[str, Any] = {"type": type(default), "default": default}
            own.add_argument(f"--{name}", **({"action": "store_true"} if default is False else how))
    options = parser.parse_args(arguments)
    options.date = datetime.datetime.now(tz=datetime.UTC).date()
    if getattr(options, "sealed", False):
        options.commit = sealed_commit(options.bench)
        options.seed = int(options.commit[:8], 16) % 10**6
    return options


def sealed_commit(bench: str) -> str:
    """Return the commit whose sealed run this is.

    Raises:
        SystemExit: a change is not committed, or the commit has had its run.
    """
    git = partial(subprocess.check_output, cwd=ROOT, encoding="utf-8")
    if changed := git(["git", "status", "--porcelain", "--", ".", f":!{FILE.as_posix()}"]):
        raise SystemExit(f"a sealed run needs a commit, and this is not committed:\n{changed}")
    commit = str(git(["git", "rev-parse", "HEAD"])).strip()
    if f",{commit},{bench}," in (ROOT / FILE).read_text(encoding="utf-8"):
        raise SystemExit(
            f"{FILE} has the run of {bench} for {commit[:12]}: it has one for a commit"
        )
    return commit


def note(options: argparse.Namespace, figures: Mapping[str, str]) -> None:
    """Append the figures of a sealed run, by name, to the file; those of other runs are not."""
    if options.sealed:
        known = "; ".join(f"{name} {value}" for name, value in figures.items())
        with (ROOT / FILE).open("a", newline="", encoding="utf-8") as file:
            file.write(
                f'{options.date},{options.commit},{options.bench},{options.seed},"{known}"\n'
            )


def all_rows(
    options: argparse.Namespace,
    judge: Callable[[Path, Truth], list[Row]],
    logs: Mapping[str, Callable[[], Any]],
) -> list[Row]:
    """Return what ``judge`` returns of all logs and their truths in order.

    ``logs`` has what makes a log, by its name; the folder of --logs keeps it. How many are done is
    printed to stderr.
    """
    spawn, rows = get_context("spawn"), list[Row]()
    with tempfile.TemporaryDirectory() as scratch, ProcessPoolExecutor(2, spawn) as pool:
        folder = Path(options.logs or scratch)
        folder.mkdir(parents=True, exist_ok=True)
        do, do_all = partial(log_rows, judge, folder), pool.map if options.jobs > 1 else map
        for done, some in enumerate(do_all(do, count(), logs, logs.values()), 1):
            end = "\n" * (done == len(logs))
            print(f"\r{done} of {len(logs)} ", end=end, file=sys.stderr, flush=True)
            rows += some
    return rows


def log_rows(
    judge: Callable[[Path, Truth], list[Row]],
    folder: Path,
    number: int,
    name: str,
    make: Callable[[], Any],
) -> list[Row]:
    """Return the rows of one log, with what its truth has by name: texts, numbers, flags.

    Each also has the log's number, its name, and the name's first word.
    """
    from checks.judge import kept  # here, as its memory would count in the bench ``link``

    log, truth = kept(folder, name, make)
    facts = {key: value for key, value in truth.items() if not isinstance(value, (list, dict))}
    facts |= {"number": number, "name": name, "log": name.split("_")[0]}
    return [facts | row for row in judge(log, truth)]


def best(calls: Mapping[str, Callable[[], float]], rounds: int) -> dict[str, float]:
    """Return the least of what each call returns in all rounds; the calls take turns."""
    turns = [{name: call() for name, call in calls.items()} for _ in range(rounds)]
    return {name: min(turn[name] for turn in turns) for name in calls}


def table(first: str, rows: Mapping[str, Mapping[str, object]]) -> Iterator[str]:
    """Yield a table of named rows, whose cells are by column; unknown numbers have a dash.

    A bench's first header begins with "".
    """
    for number, (name, of) in enumerate(rows.items()):
        if number == 0:
            yield f"| {' | '.join([first, *of])} |\n{'|---' * (len(of) + 1)}|"
        row = f"| {' | '.join([name, *map(str, of.values())])} |"
        yield row.replace("+nan", "-").replace("nan", "-")


Groups = Sequence[tuple[str, str, Collection[object]]]
"""Conditions that have a row in a table: what their rows are called, with {} for the value, a name
of Row, and its values in order; without values they are all, in the order of the flights."""


def groups(rows: Sequence[Row], of: Groups) -> dict[str, list[Row]]:
    """Return the rows of each value of each condition that was flown, by what it is called."""
    return {
        called.format(value): its
        for called, name, values in of
        for value in values or dict.fromkeys(row[name] for row in rows)
        if (its := [row for row in rows if row[name] == value])
    }


def refusals(rows: Iterable[Row]) -> str:
    """Return which fatal reason came first in how many of the logs that were refused."""
    refused = (row["fatal"] or "not judged" for row in rows if not row["usable"])
    first = Counter(fatal.split(" ")[0] for fatal in refused)
    return ", ".join(f"{reason} {count}" for reason, count in first.most_common())


METHODS = ("rml", "els")
"""Kinds of rows (checks/judge.py) that have no verdict of their own."""
FAR = 3.5
OF_Z, LEAST_ROW = (("z", 1.3), ("in 2 sigma %", 94.0)), 20
"""Limits of the root mean square of z and of the share of z within 2, and the answers that a
condition needs for them to be criteria."""
KEYS = {"wn": ("wn_error_pct", "wn_z"), "zeta": ("zeta_error", "zeta_z")} | {
    f"{name} of the mean": (error, f"{name}_z_mean")
    for name, error in (("wn", "wn_error_pct"), ("zeta", "zeta_error"))
}
"""The columns with error and z of a number; any other number has its own name in them."""
FIGURES: dict[str, Callable[[Floats], float]] = {
    "count": lambda x: float(np.sum(np.isfinite(x[:, 1]))),
    "answered %": lambda x: known(np.mean, 100.0 * np.isfinite(x[:, 1])),
    "median": lambda x: known(np.median, np.abs(x[:, 1])),
    "mean": lambda x: known(np.mean, x[:, 1]),
    "size of the mean": lambda x: abs(known(np.mean, x[:, 1])),
    "RMS": lambda x: known(np.mean, x[:, 1] ** 2) ** 0.5,
    "worst": lambda x: known(np.max, np.abs(x[:, 1])),
    "z": lambda x: known(np.mean, x[:, 2] ** 2) ** 0.5,
    "in 2 sigma %": lambda x: known(np.mean, 100.0 * (np.abs(x[np.isfinite(x[:, 1]), 2]) <= 2.0)),
    "beyond": lambda x: float(np.sum(np.abs(x[:, 2]) > FAR)),
}
"""Figures of errors (n, 3)."""


def known(figure: Callable[[Floats], Any], values: Floats) -> float:
    """Return a figure, such as ``np.median``, of the known values; NaN without any."""
    values = values[np.isfinite(values)]
    return float(figure(values)) if len(values) else np.nan


def errors(rows: Iterable[Row], kind: str, name: str) -> Floats:
    """Return flight, error and z (n, 3) of a number in the rows of one kind.

    Error and z are NaN without an estimate or a truth, and of an answer that is not usable.
    """
    keys = KEYS.get(name, (f"{name}_error_pct", f"{name}_z"))
    found = [
        [row["number"], *(row.get(x) if row["usable"] or kind in METHODS else None for x in keys)]
        for row in rows if row["kind"] == kind
    ]  # fmt: skip
    return np.array(found, float).reshape(-1, 3)


def figures(rows: Iterable[Row], kind: str, name: str) -> dict[str, float]:
    """Return all FIGURES of a number."""
    off = errors(rows, kind, name)
    return {figure: of(off) for figure, of in FIGURES.items()}


def cells(rows: Sequence[Row], kind: str, end: str = "") -> dict[str, str]:
    """Return the cells of one kind of estimate by column; a flight's mean has the ``end``.

    Of the errors of wn in % and of zeta they are the median size, the mean and the root mean
    square; then the root mean square of z and the share of z within 2 (wn, zeta), and how many of
    both are beyond FAR.
    """
    wn, zeta = (figures(rows, kind, name + end) for name in ("wn", "zeta"))
    return {
        "count": f"{wn['count']:.0f}", "answered %": f"{wn['answered %']:.0f}",
        "wn off %, median": f"{wn['median']:.2f}", "wn mean": f"{wn['mean']:+.2f}",
        "wn RMS": f"{wn['RMS']:.2f}", "zeta mean": f"{zeta['mean']:+.4f}",
        "zeta RMS": f"{zeta['RMS']:.4f}", "z wn, zeta": f"{wn['z']:.2f} {zeta['z']:.2f}",
        "in 2 sigma %": f"{wn['in 2 sigma %']:.0f} {zeta['in 2 sigma %']:.0f}",
        f"beyond {FAR:g}": f"{wn['beyond'] + zeta['beyond']:.0f}",
    }  # fmt: skip


Limits = Sequence[tuple[Mapping[str, object], str, str, float]]
"""Criteria: conditions, a number, a figure of it, and its limit, which is the least of a share."""


def criteria(
    rows: Sequence[Row],
    kind: str,
    limits: Limits,
    of: Mapping[str, Sequence[Row]],
    draws: int = 500,
    names: Sequence[str] = ("wn", "zeta"),
) -> Iterator[str]:
    """Yield the limits of the rows of a kind that a figure misses by more than its own error.

    In each group ``of`` rows with LEAST_ROW answers and more, z of ``names`` has the limits OF_Z.
    The own error is the standard deviation over ``draws`` draws of the flights: 0 of one draw, and
    of a count.
    """
    checks: list[tuple[str, Sequence[Row], str, str, float]] = [
        (", ".join([name, *map(str, where.values())]), its, name, figure, limit)
        for where, name, figure, limit in limits
        if (its := [row for row in rows if dict(where, kind=kind).items() <= row.items()])
        or not where
    ]
    checks += [
        (f"{name}, {called}", its, name, figure, limit)
        for (called, its), name, (figure, limit) in product(of.items(), names, OF_Z)
        if FIGURES["count"](errors(its, kind, name)) >= LEAST_ROW
    ]
    for what, some, name, figure, limit in checks:
        off, value, rng = errors(some, kind, name), FIGURES[figure], np.random.default_rng(0)
        off = off[np.isfinite(off[:, 1]) | (figure == "answered %")]
        flights = [off[off[:, 0] == each] for each in np.unique(off[:, 0])]
        times = (1 if figure == "beyond" else draws), len(flights)
        error = np.std([
            value(np.concatenate([off[:0], *(flights[i] for i in drawn)]))
            for drawn in rng.integers(max(len(flights), 1), size=times)
        ])  # fmt: skip
        over = (value(off) - limit) * (-1.0 if "%" in figure else 1.0)
        if not over <= error:
            shown = f"{value(off):.3g} ± {error:.2g}, limit {limit:g}"
            yield f"{NOT_MET}{kind}, {what}: {figure}: {shown}"
