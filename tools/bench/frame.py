"""One frame for all benches: options, rows of flights, errors in sigma, tables, sealed runs.

    python tools/bench.py NAME [options] [--readme]

A bench is a function of the options named in BENCHES. It yields the lines of one or two Markdown
tables, with a blank line between them, and then what else it found. A line that begins with NOT_MET
names an aim that was missed: the exit code is 1 then. With ``--readme`` the tables are also written
to tools/README.md, below their markers: see ``PLACES``.

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
from itertools import groupby, product
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
    "truth": ("truth", {"seed": 162, "flights": 0, "nonlinear": False} | FLOWN),
    "lateral": ("truth", {"seed": 913, "flights": 0} | FLOWN),
    "verdict": ("verdict", {"excited": 120, "unexcited": 210, "misled": 0} | FLOWN),
    "ordinary": ("verdict", FLOWN | {
        "seed": 2000, "jsbsim": 80, "small": 24, "hostile": 110, "seconds": 900.0,
    }),
    "damper": ("damper", {"cases": 100} | FLOWN),
    "estimator": ("speed", {"rounds": 60}),
    "link": ("speed", {}),
    "start": ("programs", {"rounds": 5}),
    "live": ("programs", {"soak": False}),
    "fleet": ("programs", {"count": 2000, "workers": 2}),
}  # fmt: skip
"""The module of each bench, and its options with their defaults; False is a flag."""
PLACES = {"truth": ["truth", "truth_by"], "ordinary": ["ordinary", "ordinary_hostile"]}
"""The markers of a bench's tables. A bench that is not here writes its first table, below the
marker of its own name."""
KINDS = ("sealed", "nonlinear")
"""Options whose table has a marker of its own."""
NOT_MET = "not met: "
ROOT = Path(__file__).resolve().parents[2]
FILE = Path("tools", "flights", "sealed.csv")


def main(arguments: list[str]) -> int:
    """Run the bench named first with the options that follow; return 1 if it missed an aim.

    The first cell of the first header, which a bench leaves empty, gets the command and the date;
    a path in it is replaced by LOG.
    """
    if not arguments or arguments[0] not in BENCHES:
        print(f"usage: bench.py {'|'.join(BENCHES)} [options] [--readme]", file=sys.stderr)
        return 2
    module, defaults = BENCHES[arguments[0]]
    bench = getattr(importlib.import_module(f"bench.{module}"), arguments[0])
    options = options_of(arguments, defaults, bench.__doc__)
    shown = ["LOG" if "/" in each else each for each in arguments if each != "--readme"]
    lines: list[str] = []
    for text in bench(options):
        made = "|  |" if lines else f"| `{' '.join(shown)}`, {today()} |"
        lines.append(text.replace("|  |", made))
        print(lines[-1], flush=True)
    if options.readme:
        own = [f"{options.bench}_{kind}" for kind in KINDS if vars(options)[kind]]
        places = own or PLACES.get(options.bench, [options.bench])
        tables = (some for is_row, some in groupby(lines, lambda x: x.startswith("|")) if is_row)
        for place, table in zip(places, tables, strict=False):
            put(place, "\n".join(table))
    return int(any(text.startswith(NOT_MET) for text in lines))


def options_of(
    arguments: Sequence[str], defaults: Mapping[str, Any], text: str
) -> argparse.Namespace:
    """Return the options of a bench; a sealed run gets its commit's seed."""
    parser = argparse.ArgumentParser(prog="bench.py", description=text)
    parser.add_argument("bench")
    parser.set_defaults(**dict.fromkeys(KINDS, False))
    for name, default in {**defaults, "readme": False}.items():
        how: dict[str, Any] = {"type": type(default), "default": default}
        flag: dict[str, Any] = {"action": "store_true"}
        parser.add_argument(f"--{name}", **(flag if default is False else how))
    options = parser.parse_args(arguments)
    if options.sealed:
        options.commit = sealed_commit(options.bench)
        options.seed = int(options.commit[:8], 16) % 10**6
    return options


def sealed_commit(bench: str) -> str:
    """Return the commit whose sealed run this is.

    Raises:
        SystemExit: a change is not committed, or the commit has had its run.
    """
    if changed := _git("status", "--porcelain", "--", ".", f":!{FILE.as_posix()}"):
        raise SystemExit(f"a sealed run needs a commit, and this is not committed:\n{changed}")
    commit = _git("rev-parse", "HEAD").strip()
    if f",{commit},{bench}," in (ROOT / FILE).read_text(encoding="utf-8"):
        raise SystemExit(
            f"{FILE} has the run of {bench} for {commit[:12]}: it has one for a commit"
        )
    return commit


def _git(*arguments: str) -> str:
    return subprocess.run(
        ["git", *arguments], cwd=ROOT, capture_output=True, check=True, encoding="utf-8"
    ).stdout


def note(options: argparse.Namespace, figures: Mapping[str, str]) -> None:
    """Append the figures of a sealed run, by name, to the file; those of other runs are not."""
    if options.sealed:
        known = "; ".join(f"{name} {value}" for name, value in figures.items())
        run = f"{today()},{options.commit},{options.bench},{options.seed}"
        with (ROOT / FILE).open("a", newline="", encoding="utf-8") as file:
            file.write(f'{run},"{known}"\n')


def today() -> datetime.date:
    """Return the date in UTC."""
    return datetime.datetime.now(tz=datetime.UTC).date()


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
        tasks = [(number, *log) for number, log in enumerate(logs.items())]
        do = partial(log_rows, judge, folder)
        found = pool.map(do, tasks) if options.jobs > 1 else map(do, tasks)
        for done, some in enumerate(found, 1):
            print(f"\r{done} of {len(tasks)} ", end="", file=sys.stderr, flush=True)
            rows += some
    print(file=sys.stderr)
    return rows


def log_rows(
    judge: Callable[[Path, Truth], list[Row]],
    folder: Path,
    task: tuple[int, str, Callable[[], Any]],
) -> list[Row]:
    """Return the rows of one log; each also has its number, its name, and the name's first word."""
    from checks.judge import kept  # here, as its memory would count in the bench ``link``

    number, name, make = task
    own = {"number": number, "name": name, "log": name.split("_")[0]}
    return [own | row for row in judge(*kept(folder, name, make))]


def best(calls: Mapping[str, Callable[[], float]], rounds: int) -> dict[str, float]:
    """Return the least of what each call returns in all rounds; the calls take turns."""
    turns = [{name: call() for name, call in calls.items()} for _ in range(rounds)]
    return {name: min(turn[name] for turn in turns) for name in calls}


def table(first: str, rows: Iterable[tuple[str, Mapping[str, object]]]) -> Iterator[str]:
    """Yield a table of named rows, whose cells are by column; unknown numbers have a dash.

    A bench's first header begins with "".
    """
    for number, (name, of) in enumerate(rows):
        if number == 0:
            yield f"| {' | '.join([first, *of])} |"
            yield "|---" * (len(of) + 1) + "|"
        cells = " | ".join([name, *map(str, of.values())])
        yield f"| {cells} |".replace("+nan", "-").replace("nan", "-")


Groups = Sequence[tuple[str, str, Collection[object]]]
"""Conditions that have a row in a table: what their rows are called, with {} for the value, a name
of Row, and its values in order; without values they are all, in the order of the flights."""


def groups(rows: Sequence[Row], of: Groups) -> Iterator[tuple[str, list[Row]]]:
    """Yield for each value of each condition that was flown how it is called, and its rows."""
    for called, name, values in of:
        for value in values or dict.fromkeys(row[name] for row in rows):
            if its := [row for row in rows if row[name] == value]:
                yield called.format(value), its


def refusals(rows: Iterable[Row]) -> str:
    """Return which fatal reason came first in how many of the logs that were refused."""
    fatal = (row["fatal"].split() for row in rows if not row["usable"])
    first = Counter(reasons[0] if reasons else "not judged" for reasons in fatal)
    return ", ".join(f"{reason} {count}" for reason, count in first.most_common())


METHODS = ("rml", "els")
"""Kinds of rows (checks/judge.py) that have no verdict of their own."""
FAR = 3.5
OF_Z, LEAST_ROW = (("z", 1.3), ("in 2 sigma %", 94.0)), 20
"""Limits of the root mean square of z and of the share of z within 2, and the answers that a
condition needs for them to be criteria."""
DRAWS = 500
KEYS = {"wn": ("wn_error_pct", "wn_z"), "zeta": ("zeta_error", "zeta_z")} | {
    f"{name} of the mean": (error, f"{name}_z_mean")
    for name, error in (("wn", "wn_error_pct"), ("zeta", "zeta_error"))
}
"""The columns with error and z of a number; any other number has its own name in them."""
FIGURES: dict[str, Callable[[Floats], float]] = {
    "median": lambda x: known(np.median, np.abs(x[:, 1])),
    "mean": lambda x: known(np.mean, x[:, 1]),
    "size of the mean": lambda x: abs(known(np.mean, x[:, 1])),
    "RMS": lambda x: known(rms, x[:, 1]),
    "worst": lambda x: known(np.max, np.abs(x[:, 1])),
    "z": lambda x: known(rms, x[:, 2]),
    "in 2 sigma %": lambda x: 100.0 * known(np.mean, np.array(np.abs(x[:, 2]) <= 2.0, float)),
    "beyond": lambda x: float(np.sum(np.abs(x[:, 2]) > FAR)),
}
"""Figures of errors (n, 3)."""


def known(figure: Callable[[Floats], Any], values: Floats) -> float:
    """Return a figure, such as ``np.median``, of the known values; NaN without any."""
    values = values[np.isfinite(values)]
    return float(figure(values)) if len(values) else np.nan


def rms(values: Floats) -> Any:
    """Return the root mean square."""
    return np.sqrt(np.mean(values**2))


def estimates(rows: Iterable[Row], kind: str) -> list[Row]:
    """Return the rows of one kind that have an estimate and a truth, and are usable if judged."""
    return [row for row in rows if row["kind"] == kind
            and (row["usable"] or kind in METHODS) and row["wn_error_pct"] is not None]  # fmt: skip


def errors(rows: Iterable[Row], kind: str, name: str) -> Floats:
    """Return flight, error and z (n, 3) of a number, of the estimates that have it."""
    keys = ("number", *KEYS.get(name, (f"{name}_error_pct", f"{name}_z")))
    found = [[row[key] for key in keys] for row in estimates(rows, kind) if keys[1] in row]
    return np.array(found, float).reshape(-1, 3)


def cells(rows: Sequence[Row], kind: str, end: str = "") -> dict[str, str]:
    """Return the cells of one kind of estimate by column; a flight's mean has the ``end``.

    Of the errors of wn in % and of zeta they are the median size, the mean and the root mean
    square; then the root mean square of z and the share of z within 2 (wn, zeta), and how many of
    both are beyond FAR.
    """
    both = [errors(rows, kind, name + end) for name in ("wn", "zeta")]
    wn, zeta = ({name: figure(of) for name, figure in FIGURES.items()} for of in both)
    flown = sum(row["kind"] == kind for row in rows)
    return {
        "count": f"{len(both[0])}", "answered %": f"{100.0 * len(both[0]) / max(flown, 1):.0f}",
        "wn off %, median": f"{wn['median']:.2f}", "wn mean": f"{wn['mean']:+.2f}",
        "wn RMS": f"{wn['RMS']:.2f}", "zeta mean": f"{zeta['mean']:+.4f}",
        "zeta RMS": f"{zeta['RMS']:.4f}", "z wn, zeta": f"{wn['z']:.2f} {zeta['z']:.2f}",
        "in 2 sigma %": f"{wn['in 2 sigma %']:.0f} {zeta['in 2 sigma %']:.0f}",
        f"beyond {FAR:g}": f"{wn['beyond'] + zeta['beyond']:.0f}",
    }  # fmt: skip


def missed(what: str, figure: str, of: Floats, limit: float, draws: int = DRAWS) -> Iterator[str]:
    """Yield that a figure of errors misses its limit by more than its own error, if it does.

    Its own error is its standard deviation over ``draws`` draws of the flights, 0 without draws.
    The limit of a share is the least value, not the largest.
    """
    value, rng, error = FIGURES[figure], np.random.default_rng(0), 0.0
    if draws and len(of):
        flight = np.unique(of[:, 0], return_inverse=True)[1]
        n = int(flight.max()) + 1
        times = (np.bincount(each, minlength=n) for each in rng.integers(n, size=(draws, n)))
        error = float(np.std([value(np.repeat(of, each[flight], axis=0)) for each in times]))
    over = (value(of) - limit) * (-1.0 if "%" in what + figure else 1.0)
    if not over <= error:
        yield f"{NOT_MET}{what}: {figure}: {value(of):.3g} ± {error:.2g}, limit {limit:g}"


def rows_missed(
    some: Iterable[tuple[str, Sequence[Row]]], kind: str, draws: int = DRAWS
) -> Iterator[str]:
    """Yield each group of LEAST_ROW answers and more whose z misses a limit of OF_Z."""
    for (called, its), name, (figure, limit) in product(some, ("wn", "zeta"), OF_Z):
        if len(of := errors(its, kind, name)) >= LEAST_ROW:
            yield from missed(f"{name}, {called}", figure, of, limit, draws)
