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
}
"""The files of some tables; all others are in tools/README.md."""
_BELOW = r"(?:```\n(?s:.*?)```\n|(?:\|[^\n]*\n)*)"
"""What a marker is followed by: a table, or an output in a block of its own."""


def put(name: str, table: str) -> None:
    """Replace the table below ``<!-- name -->``; the new one must not have blank lines.

    Raises:
        SystemExit: the file has no such marker, or several.
    """
    path = ROOT / HOMES.get(name, "tools/README.md")
    marker = f"<!-- {name} -->\n"
    text, count = re.subn(
        marker + _BELOW,
        lambda _: marker + table.strip() + "\n",
        path.read_text(encoding="utf-8"),
    )
    if count != 1:
        raise SystemExit(f"{path} has {count} times {marker.strip()}: one is needed")
    path.write_text(text, encoding="utf-8")


def written(name: str) -> str:
    """Return the table that the file has now; "" without one."""
    text = (ROOT / HOMES.get(name, "tools/README.md")).read_text(encoding="utf-8")
    found = re.search(rf"<!-- {name} -->\n({_BELOW})", text)
    return found[1].strip() if found else ""


def cases() -> str:
    """Return the table of the cases in replay_logs/, as their case.toml describes them."""
    rows = []
    for path in sorted((ROOT / "replay_logs").glob("*/case.toml")):
        case = tomllib.loads(path.read_text(encoding="utf-8"))
        # Most references contain only the stream's answer; the option "manoeuvres off" is left out.
        given = ({"manoeuvres": "auto"} | case.get("options", {})).items()
        given = [(k, v) for k, v in given if (k, v) != ("manoeuvres", "off")]
        options = ", ".join(f"{k} {v:g}" if isinstance(v, float) else f"{k} {v}" for k, v in given)
        origin = re.sub(r"[,;] (recorded|tools/|see ).*", "", case["origin"])
        origin = re.sub("^JSBSim C172P at 100 kt, |ArduPlane V4.6-dev SITL ", "", origin)
        rows.append(f"| {path.parent.name} | {origin} | {options or 'none'} |")
    return "\n".join(["| case | its log | options |", "|---|---|---|", *rows])


def reasons() -> str:
    """Return every reason with its exit code, 0 of a warning, and what to do about it."""
    rows = [f"| `{kind.id}` | {kind.exit_code} | {kind.now} |" for kind in KINDS.values()]
    return "\n".join(["| reason | exit code (0: a warning) | what to do |", "|---|---|---|", *rows])


def exit_codes() -> str:
    """Return what each exit code says."""
    rows = [f"| {code} | {says} |" for code, says in EXIT_CODES.items()]
    return "\n".join(["| exit code | what it says |", "|---|---|", *rows])


def truth_short() -> str:
    """Return the first table of the bench ``truth`` for users: without its command and methods."""
    head, *rows = written("truth").splitlines()
    head = "| JSBSim |" + head.split("|", 2)[2]
    return "\n".join([head, *(row for row in rows if not re.match(r"\| (ELS|RML),", row))])


@cache
def _folder() -> TemporaryDirectory[str]:
    """Return the folder in which lines are typed; it has the cases."""
    folder = TemporaryDirectory()
    (Path(folder.name) / "replay_logs").symlink_to(ROOT / "replay_logs")
    return folder


@cache
def _printed(line: str) -> list[str]:
    """Return the lines that a command prints for people, after the log's path."""
    program, *arguments = shlex.split(line)
    said = subprocess.run(
        [sys.executable, "-m", program, *arguments],
        cwd=_folder().name, stdout=subprocess.PIPE, check=False, encoding="utf-8",
    )  # fmt: skip
    return [line.rstrip() for line in said.stdout.splitlines()[1:]]


def _shown(name: str, until: str, since: str = "", line: str = "") -> str:
    """Return what a line prints, from one that begins with ``since`` to one with ``until``.

    Without ``line`` it is the last of the lines to type in the last block before the marker, after
    the others were typed.
    """
    before = (ROOT / HOMES[name]).read_text(encoding="utf-8").split(f"<!-- {name} -->")[0]
    blocks = re.findall(r"```sh\n(.*?)```", before, re.DOTALL)
    for each in [line] if line else blocks[-1].splitlines():
        printed = _printed(each)
    lines = dropwhile(lambda each: not each.startswith(since), printed)
    shown = takewhile(lambda each: not each.startswith(until), lines)
    return "\n".join(["```", *shown, "```"])


_FLIGHT = "yawid replay replay_logs/{}/log.tlog --out {}".format
_OUTPUTS: dict[str, tuple[str, ...]] = {
    "answer": ("n from-to", "", _FLIGHT("c172p_3211", "answer")),
    "good": ("  rudder", "", _FLIGHT("c172p_3211", "answer")),
    "refusal": ("± is one sigma", "", _FLIGHT("turns_calm", "refusal")),
    "bare": ("n from-to",), "gain": ("mix ",), "mix": ("± is one sigma", "mix "),
}  # fmt: skip
TABLES: dict[str, Callable[[], str]] = {
    "cases": cases, "reasons": reasons, "exit_codes": exit_codes, "truth_short": truth_short,
} | {name: partial(_shown, name, *found) for name, found in _OUTPUTS.items()}  # fmt: skip


if __name__ == "__main__":
    for table_name, table_of in TABLES.items():
        put(table_name, table_of())
