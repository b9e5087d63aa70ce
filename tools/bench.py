"""Benches, each printing a Markdown table: python tools/bench.py NAME [options] [--readme].

With ``--readme`` the table is also written to tools/README.md, below its marker.
"""

from __future__ import annotations

import datetime
import importlib
import os
import shlex
import sys

from readme_tables import put

BENCHES = (
    "estimator",
    "efficiency",
    "windup",
    "confidence",
    "link",
    "live",
    "replay",
    "aliasing",
    "memory",
    "aircraft",
    "manoeuvres",
)


def run(name: str, options: list[str]) -> str:
    """Run one bench, print the lines of its table as they come, and return them.

    The first cell of the header, which the bench leaves empty, is what was run (paths without their
    names) and when.
    """
    options_told = list(dict.fromkeys("LOG" if os.sep in each else each for each in options))
    today = datetime.datetime.now(tz=datetime.UTC).date()
    made = f"| `{shlex.join([name, *options_told])}`, {today} |"
    lines: list[str] = []
    for line in importlib.import_module(f"bench_{name}").main(options):
        lines.append(line if lines else line.replace("| |", made, 1))
        print(lines[-1], flush=True)
    return "\n".join(lines)


def main(arguments: list[str]) -> int:
    """Run the bench that is named first; the rest are its options."""
    if not arguments or arguments[0] not in BENCHES:
        print(f"usage: bench.py {'|'.join(BENCHES)} [options] [--readme]", file=sys.stderr)
        return 2
    name, *options = arguments
    table = run(name, [option for option in options if option != "--readme"])
    if "--readme" in options:
        put(name, table)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
