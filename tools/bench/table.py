"""What the benches share: their options, the rows of all their flights, statistics, Markdown."""

from __future__ import annotations

import argparse
import csv
import math
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
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

    A tuple takes several values, False is a flag, a type is that of an option without a default,
    and None is a path that must be given, without its name.
    """
    parser = argparse.ArgumentParser(
        prog=f"bench.py {bench}",
        description=text,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    for name, default in defaults.items():
        add = partial(parser.add_argument, f"--{name.replace('_', '-')}")
        if default is None:
            parser.add_argument(name, type=Path)
        elif default is False:
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


def column(rows: Sequence[Row], name: str) -> Floats:
    """Return a column of rows (n,), NaN where a row has no number."""
    return np.array([row[name] for row in rows], float)


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
