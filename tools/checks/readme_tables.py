<<<<<<< HEAD
"""Writes the tables of the READMEs that programs make, each below a marker.

    python -m checks.readme_tables         # the tables made from the tree: cases and mutations
    python tools/bench.py NAME --readme    # a bench's table, in tools/README.md

tests/test_readme.py checks that the tables of cases and mutations are up to date.
=======
"""Tables of the READMEs and the manual that a program writes: from a marker to a blank line.

    python -m checks.readme_tables         # the tables that the tree itself gives
    python tools/bench.py NAME --readme    # a bench's table, in tools/README.md

tests/test_readme.py holds the first to what this gives.
>>>>>>> b550d09 (A manual, and yawid explain, which prints the part of it on a word)
"""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

from checks.defects import DEFECTS

from yawid.errors import EXIT_CODES
from yawid.results.reasons import KINDS

ROOT = Path(__file__).resolve().parents[2]
HOMES = {
    "cases": "replay_logs/README.md",
    "mutations": "tests/README.md",
    "truth_short": "src/yawid/manual/accuracy.md",
    "reasons": "src/yawid/manual/reasons.md",
    "exit_codes": "src/yawid/manual/reasons.md",
}
"""The files of some tables; all others are in tools/README.md."""


def put(name: str, table: str) -> None:
    """Replace the table below ``<!-- name -->``; the new one must not have blank lines.

    Raises:
        SystemExit: the file has no such marker, or several.
    """
    path = ROOT / HOMES.get(name, "tools/README.md")
    marker = f"<!-- {name} -->\n"
    text, count = re.subn(
        rf"{marker}(?:\|[^\n]*\n)*",
        lambda _: marker + table.strip() + "\n",
        path.read_text(encoding="utf-8"),
    )
    if count != 1:
        raise SystemExit(f"{path} has {count} times {marker.strip()}: one is needed")
    path.write_text(text, encoding="utf-8")


def written(name: str) -> str:
    """Return the table that the file has now; "" without one."""
    text = (ROOT / HOMES.get(name, "tools/README.md")).read_text(encoding="utf-8")
    found = re.search(rf"<!-- {name} -->\n((?:\|[^\n]*\n)*)", text)
    return found[1].strip() if found else ""


def mutations() -> str:
    """Return the table of checks/defects.toml: each defect with the test that must fail."""
    rows = [
        f"| {d.what} | {Path(d.file).stem} | {Path(d.test.replace('.py', '')).name[5:]} |"
        for d in DEFECTS
    ]
    return "\n".join(["| defect | file | caught by |", "|---|---|---|", *rows])


def cases() -> str:
    """Return the table of the cases in replay_logs/, as their case.toml describes them."""
    rows = []
    for path in sorted((ROOT / "replay_logs").glob("*/case.toml")):
        case = tomllib.loads(path.read_text(encoding="utf-8"))
        # Most references contain only the stream's answer; the option "manoeuvres off" is left out.
        given = ({"manoeuvres": "auto"} | case.get("options", {})).items()
        given = [(k, v) for k, v in given if (k, v) != ("manoeuvres", "off")]
        options = ", ".join(f"{k} {v:g}" if isinstance(v, float) else f"{k} {v}" for k, v in given)
        origin = re.sub(r"[,;] (trimmed|recorded|tools/|see ).*", "", case["origin"])
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


TABLES = {"cases": cases, "mutations": mutations, "reasons": reasons, "exit_codes": exit_codes}


if __name__ == "__main__":
    for table_name, table_of in TABLES.items():
        put(table_name, table_of())
