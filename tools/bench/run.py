"""Runs a bench, which prints a Markdown table: python tools/bench.py NAME [options] [--readme].

With ``--readme`` the table is also written to tools/README.md, below its marker. A bench may print
several tables with a blank line between them: see ``PLACES``.
"""

from __future__ import annotations

import datetime
import importlib
import os
import re
import shlex
import sys

from checks.readme_tables import put

BENCHES = (
    "estimator",
    "link",
    "live",
    "manoeuvres",
    "truth",
    "verdict",
    "upset",
    "releases",
    "start",
    "lateral",
    "damper",
    "ordinary",
)
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


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
