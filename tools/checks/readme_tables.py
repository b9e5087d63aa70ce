"""Writes what programs make of the READMEs and the manual: tables and outputs, below markers.

    python -m checks.readme_tables         # what is made from the tree itself
    python tools/bench.py NAME --readme    # a bench's table, in tools/README.md

tests/test_readme.py checks that what is made from the tree is up to date.
"""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
import tomllib
from collections.abc import Callable
from functools import cache, partial
from itertools import dropwhile, takewhile
from pathlib import Path
from tempfile import TemporaryDirectory

from yawid.answers.reasons import KINDS
from yawid.errors import EXIT_CODES

ROOT = Path(__file__).resolve().parents[2]
HOMES = {
    "cases": "replay_logs/README.md",
    "truth_short": "src/yawid/manual/accuracy.md",
    "reasons": "src/yawid/manual/reasons.md",
    "exit_codes": "src/yawid/manual/reasons.md",
    "answer": "README.md",
    "refusal": "README.md",
    "good": "src/yawid/manual/first_flight.md",
    "bare": "src/yawid/manual/bare_airframe.md",
    "gain": "src/yawid/manual/what_now.md",
    "mix": "src/yawid/manual/what_now.md",
    "after": "src/yawid/manual/what_now.md",
}
"""The files of some tables; all others are in tools/README.md."""
_BELOW = r"(?:```\n(?s:.*?)```\n|(?:\|[^\n]*\n)*)"
"""What a marker is followed by: a table, or an output in a block of its own."""


def put(name: str, table: str) -> None:
    """Replace the table below ``<!-- name -->``; the new one must not have blank lines."""
    path, before, _, after = _parts(name)
    path.write_text(f"{before}{table.strip()}\n{after}", encoding="utf-8")


def written(name: str) -> str:
    """Return the table that the file has now."""
    return _parts(name)[2].strip()


def _parts(name: str) -> tuple[Path, str, str, str]:
    """Return the file of a table, the text before it, the table, and the text that follows.

    Raises:
        ValueError: the file has no marker ``<!-- name -->``, or several.
    """
    path = ROOT / HOMES.get(name, "tools/README.md")
    below = rf"(?<=<!-- {name} -->\n)({_BELOW})"
    before, table, after = re.split(below, path.read_text(encoding="utf-8"))
    return path, before, table, after


def cases() -> str:
    """Return the table of the cases in replay_logs/, as their case.toml describes them."""
    rows = []
    for path in sorted((ROOT / "replay_logs").glob("*/case.toml")):
        case = tomllib.loads(path.read_text(encoding="utf-8"))
        # Most references contain only the stream's answer; the option "manoeuvres off" is left out.
        given = [f"{k} {v:g}" if isinstance(v, float) else f"{k} {v}"
                 for k, v in ({"manoeuvres": "auto"} | case.get("options", {})).items()
                 if (k, v) != ("manoeuvres", "off")]  # fmt: skip
        origin = re.sub(
            r"^JSBSim C172P at 100 kt, |^ArduPlane V4.6-dev SITL |[,;] (recorded|tools/|see ).*",
            "", case["origin"],
        )  # fmt: skip
        rows.append(f"| {path.parent.name} | {origin} | {', '.join(given) or 'none'} |")
    return "\n".join(["| case | its log | options |", "|---|---|---|", *rows])


def reasons() -> str:
    """Return every reason with its exit code, 0 of a warning, and what to do about it."""
    return "\n".join(
        [
            "| reason | exit code (0: a warning) | what to do |",
            "|---|---|---|",
            *(f"| `{kind.id}` | {kind.exit_code} | {kind.now} |" for kind in KINDS.values()),
        ]
    )


def exit_codes() -> str:
    """Return what each exit code says."""
    return "\n".join(
        [
            "| exit code | what it says |",
            "|---|---|",
            *(f"| {code} | {says} |" for code, says in EXIT_CODES.items()),
        ]
    )


def truth_short() -> str:
    """Return the first table of the bench ``truth`` for users: without its command and methods."""
    head, *rows = written("truth").splitlines()
    kept = [row for row in rows if not row.startswith(("| ELS,", "| RML,"))]
    return "\n".join(["| JSBSim |" + head.split("|", 2)[2], *kept])


_FOLDER = cache(TemporaryDirectory)
"""The folder in which lines are typed."""


@cache
def _printed(line: str) -> list[str]:
    """Return the lines that a command prints for people, after the log's path."""
    line = line.replace(" replay_logs/", f" {ROOT}/replay_logs/")
    said = subprocess.run(
        [sys.executable, "-m", *shlex.split(line)],
        cwd=_FOLDER().name, stdout=subprocess.PIPE, check=False, encoding="utf-8",
    )  # fmt: skip
    return [line.rstrip() for line in said.stdout.splitlines()[1:]]


def to_type(name: str) -> list[str]:
    """Return the lines to type in the last block before a marker."""
    return _parts(name)[1].rpartition("```sh\n")[2].partition("```")[0].splitlines()


def _shown(name: str, until: str, since: str = "", line: str = "") -> str:
    """Return what a line prints, from one that begins with ``since`` to one with ``until``.

    Without ``line`` it is the last of the lines to type, after the others were typed.
    """
    *_, printed = map(_printed, [line] if line else to_type(name))
    shown = takewhile(
        lambda each: not each.startswith(until),
        dropwhile(lambda each: not each.startswith(since), printed),
    )
    return "\n".join(["```", *shown, "```"])


_FLIGHT = "yawid replay replay_logs/{}/log.tlog --out {}".format
TABLES: dict[str, Callable[[], str]] = {
    "cases": cases, "reasons": reasons, "exit_codes": exit_codes, "truth_short": truth_short,
} | {name: partial(_shown, name, *found) for name, found in {
    "answer": ("n from-to", "", _FLIGHT("c172p_3211", "answer")),
    "good": ("  rudder", "", _FLIGHT("c172p_3211", "answer")),
    "refusal": ("± is one sigma", "", _FLIGHT("turns_calm", "refusal")),
    "bare": ("n from-to",), "gain": ("mix ",), "mix": ("± is one sigma", "mix "),
    "after": ("wn in rad/s", "the aircraft without"),
}.items()}  # fmt: skip


if __name__ == "__main__":
    for table_name, table_of in TABLES.items():
        put(table_name, table_of())
