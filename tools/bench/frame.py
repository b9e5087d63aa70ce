"""One frame for all benches: their options, the rows of all their flights, statistics, Markdown.

    python tools/bench.py NAME [options] [--readme]

A bench is a module whose ``main`` yields the lines of a Markdown table, or of several with a blank
line between them, and returns which aims were missed. With ``--readme`` the first tables are also
written to tools/README.md, below their markers: see ``PLACES``.

A run on the sealed aircraft belongs to a commit, whose hash gives its seed: one run of each bench
for a commit, with all changes committed. Its figures are a row of flights/sealed.csv, which is
never edited by hand.
"""

from __future__ import annotations

import argparse
import csv
import datetime
import importlib
import math
import os
import re
import shlex
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
from checks.readme_tables import put
from numpy.typing import NDArray

Row = dict[str, Any]
"""What is known of one estimate, by name."""
Floats = NDArray[np.float64]

FLOWN: dict[str, Any] = {"logs": Path, "jobs": 2, "csv": Path}
"""The options of a bench that flies: the folder in which its flights stay, the processes (at most
MOST_JOBS), and the file for all rows."""
MOST_JOBS = 2


def options_of(
    bench: str, text: str | None, arguments: list[str], **defaults: Any
) -> argparse.Namespace:
    """Return the options of a bench: a --NAME for each of ``defaults``, of the default's type.

    A tuple takes several values, False is a flag, a type is that of an option without a default.
    """
    parser = argparse.ArgumentParser(
        prog=f"bench.py {bench}",
        description=text,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    for name, default in defaults.items():
        add = partial(parser.add_argument, f"--{name.replace('_', '-')}")
        if default is False:
            add(action="store_true")
        elif isinstance(default, type):
            add(type=default)
        elif isinstance(default, tuple):
            add(type=type(default[0]), nargs="+", default=default)
        else:
            add(type=type(default), default=default)
    return parser.parse_args(arguments)


def all_rows(
    options: argparse.Namespace, do: Callable[[Path, Any], list[Row]], tasks: Sequence[Any]
) -> list[Row]:
    """Return the rows of ``do`` for all tasks in order, as the options of FLOWN ask.

    ``do`` gets the folder of the flights and a task.
    """
    with tempfile.TemporaryDirectory() as scratch:
        folder = options.logs or Path(scratch)
        folder.mkdir(parents=True, exist_ok=True)
        rows = in_processes(partial(do, folder), tasks, options.jobs)
    if options.csv:
        write_csv(options.csv, rows)
    return rows


def in_processes(do: Callable[[Any], list[Row]], tasks: Sequence[Any], jobs: int) -> list[Row]:
    """Return the rows of ``do`` for all tasks in order; print how many are done to stderr."""
    rows: list[Row] = []
    with ExitStack() as stack:
        found: Iterator[list[Row]] = map(do, tasks)
        if jobs > 1:
            pool = ProcessPoolExecutor(MOST_JOBS, get_context("spawn"))
            found = stack.enter_context(pool).map(do, tasks)
        for done, some in enumerate(found, 1):
            print(f"\r{done} of {len(tasks)} ", end="", file=sys.stderr, flush=True)
            rows += some
    print(file=sys.stderr)
    return rows


def write_csv(path: Path, rows: Sequence[Row]) -> None:
    """Write rows as CSV, with columns in the order in which they first appear."""
    names = list(dict.fromkeys(name for row in rows for name in row))
    with path.open("w", newline="", encoding="utf-8") as file:
        table = csv.DictWriter(file, names, lineterminator="\n")
        table.writeheader()
        table.writerows(
            {k: float(f"{v:.6g}") if isinstance(v, float) else v for k, v in row.items()}
            for row in rows
        )


def line(*cells: object) -> str:
    """Return a line of a table; the cells of unknown numbers have a dash."""
    return f"| {' | '.join(map(str, cells))} |".replace("+nan", "-").replace("nan", "-")


def head(first: str, columns: Iterable[str]) -> Iterator[str]:
    """Yield the header of a table and the line below it; a bench's first header begins with ""."""
    names = [first, *columns]
    yield line(*names)
    yield "|---" * len(names) + "|"


def known(figure: Callable[[Floats], Any], values: Floats) -> float:
    """Return a figure, such as ``np.median``, of the known values; NaN without any."""
    values = values[np.isfinite(values)]
    return float(figure(values)) if len(values) else math.nan


def rms(values: Floats) -> float:
    """Return the root mean square of the known values; NaN without any."""
    return known(lambda each: np.sqrt(np.mean(each**2)), values)


def within(values: Floats, most: float = 2.0) -> float:
    """Return how many % have a size of at most ``most``; an unknown value counts as larger."""
    return 100.0 * float(np.mean(np.abs(values) <= most)) if len(values) else math.nan


ROOT = Path(__file__).resolve().parents[2]
FILE = Path("tools", "flights", "sealed.csv")
NOTED = ("date", "commit", "bench", "seed", "figures")
SEEDS = 10**6


@dataclass(frozen=True, slots=True)
class SealedRun:
    """A run of a bench on the sealed aircraft."""

    bench: str
    commit: str

    @property
    def seed(self) -> int:
        """The seed that the commit's hash gives."""
        return int(self.commit[:8], 16) % SEEDS

    def note(self, figures: Mapping[str, str]) -> None:
        """Append the run's figures, by name, to the file."""
        path, today = ROOT / FILE, datetime.datetime.now(tz=datetime.UTC).date()
        known = "; ".join(f"{name} {value}" for name, value in figures.items())
        new = not path.exists()
        with path.open("a", newline="", encoding="utf-8") as file:
            rows = csv.writer(file, lineterminator="\n")
            rows.writerows([NOTED] * new)
            rows.writerow([today, self.commit, self.bench, self.seed, known])


def begin(bench: str) -> SealedRun:
    """Return the run of this commit.

    Raises:
        SystemExit: a change is not committed, or the commit has had its run.
    """
    if changed := _git("status", "--porcelain", "--", ".", f":!{FILE.as_posix()}"):
        raise SystemExit(f"a sealed run needs a commit, and this is not committed:\n{changed}")
    commit = _git("rev-parse", "HEAD").strip()
    if any((row["bench"], row["commit"]) == (bench, commit) for row in noted()):
        raise SystemExit(
            f"{FILE} has the run of {bench} for {commit[:12]}: it has one for a commit"
        )
    return SealedRun(bench, commit)


def noted() -> Iterator[dict[str, str]]:
    """Yield the rows of the file."""
    if (ROOT / FILE).exists():
        with (ROOT / FILE).open(newline="", encoding="utf-8") as file:
            yield from csv.DictReader(file)


def _git(*arguments: str) -> str:
    return subprocess.run(
        ["git", *arguments], cwd=ROOT, capture_output=True, check=True, encoding="utf-8"
    ).stdout


BENCHES = (
    "estimator", "link", "live", "truth", "verdict", "start", "lateral", "damper", "ordinary",
    "fleet",
)  # fmt: skip
PLACES = {"truth": ("truth", "truth_by"), "ordinary": ("ordinary", "ordinary_hostile")}
"""The markers of a bench's first tables. A bench that is not here writes its first table, below the
marker of its own name."""


def run(name: str, options: list[str]) -> tuple[str, str | None]:
    """Run one bench and print the lines of its tables; return them and which aims were missed.

    The first cell of the header, which the bench leaves empty, gets the command and the date; paths
    in it are replaced by LOG. The aims missed are what the bench's generator returns, None if it
    has none.
    """
    named = []
    for option in options:
        shown = "LOG" if os.sep in option else option
        if shown != "LOG" or "LOG" not in named:
            named.append(shown)
    today = datetime.datetime.now(tz=datetime.UTC).date()
    made = f"| `{shlex.join([name, *named])}`, {today} |"
    bench = importlib.import_module(f"bench.{name}").main(options)
    lines: list[str] = []
    while True:
        try:
            line = next(bench)
        except StopIteration as end:
            return "\n".join(lines), end.value
        lines.append(line if lines else re.sub(r"^\| *\|", lambda _: made, line))
        print(lines[-1], flush=True)


def main(arguments: list[str]) -> int:
    """Run the bench named first with the options that follow; return 1 if it missed an aim."""
    if not arguments or arguments[0] not in BENCHES:
        print(f"usage: bench.py {'|'.join(BENCHES)} [options] [--readme]", file=sys.stderr)
        return 2
    name, *options = arguments
    tables, missed = run(name, [option for option in options if option != "--readme"])
    if "--readme" in options:
        kinds = [f"{name}_{kind}" for kind in ("sealed", "nonlinear") if f"--{kind}" in options]
        places = tuple(kinds) or PLACES.get(name, (name,))
        for place, table in zip(places, tables.split("\n\n"), strict=False):
            put(place, table)
    if missed is not None:
        print(missed, file=sys.stderr)
    return 0 if missed is None else 1
