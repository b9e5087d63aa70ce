"""Runs records of real flights against a table of references that stays with them.

    python tools/bench.py real FOLDER [--jobs 2]

FOLDER has the records and references.csv, whose columns are

    file        the record's name
    options     those of yawid replay, empty for the default ones
    wn, zeta    the reference in rad/s and 1; wn is the word refuse where nothing may be usable
    tolerance   how far the answer may be off: wn in %, then, after a space, zeta

The exit code is 1 if an answer is further off, if one is missing, or if one should be refused.
"""

from __future__ import annotations

import csv
import shlex
from collections.abc import Generator
from pathlib import Path

from cases.two_commits import ROOT, answer, printed
from checks.judge import Row

from bench.table import all_rows, head, line, options_of

TABLE = "references.csv"
REFUSE = "refuse"


def judged(reference: dict[str, str], found: dict[str, object] | None, why: str) -> Row:
    """Return the row of one record: reference, answer (``wn``, ``zeta``; None if refused), verdict.

    ``why`` says why it was refused, or what was warned of.
    """
    row: Row = {"file": reference["file"], "wanted": reference["wn"], "answer": "refused"}
    row |= {"off": "", "why": why, "met": reference["wn"] == REFUSE}
    if found is None:
        return row
    wn, zeta = (float(str(found[name])) for name in ("wn_rad_s", "zeta"))
    row["answer"] = f"{wn:.3g}, {zeta:.2g}"
    if reference["wn"] == REFUSE:
        return row | {"met": False}
    row["wanted"] = f"{reference['wn']}, {reference['zeta'] or '-'}"
    limits = [float(each) for each in reference["tolerance"].split()]
    off_pct = 100.0 * (wn / float(reference["wn"]) - 1.0)
    row |= {"off": f"{off_pct:+.1f}", "met": abs(off_pct) <= limits[0]}
    if reference["zeta"]:
        off = zeta - float(reference["zeta"])
        row["off"] += f", {off:+.3f}"
        row["met"] = row["met"] and (len(limits) < 2 or abs(off) <= limits[1])
    return row


def replayed(folder: Path, reference: dict[str, str]) -> list[Row]:
    """Replay one record by the command line and return its row, as the only one of a list."""
    given = shlex.split(reference["options"] or "")
    code, found = printed(ROOT, folder / reference["file"], given)
    if "error" in found:
        last = found["error"].strip().splitlines()
        return [judged(reference, None, last[-1] if last else f"exit {code}")]
    verdict, roll = answer(found)
    return [
        judged(reference, roll, " ".join(reason["id"] for reason in verdict.get("reasons", ())))
    ]


def references(folder: Path) -> list[dict[str, str]]:
    """Return the rows of the folder's table.

    Raises:
        SystemExit: there is no table, or a column is missing.
    """
    path = folder / TABLE
    if not path.exists():
        raise SystemExit(f"{path} does not exist: it names the records and their answers")
    with path.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file, skipinitialspace=True))
    names = {"file", "options", "wn", "zeta", "tolerance"}
    if rows and (missing := names - rows[0].keys()):
        raise SystemExit(f"{path} lacks the columns {', '.join(sorted(missing))}")
    return rows


def main(arguments: list[str]) -> Generator[str, None, str | None]:
    """Yield the table; return how many records do not meet their reference, None if all do."""
    options = options_of("real", __doc__, arguments, logs=None, jobs=2, csv=Path)
    rows = all_rows(options, replayed, references(options.logs))
    columns = ("answered, within tolerance", "further off", "refused, rightly", "wrongly")
    yield from head("", ("records", *columns))
    gone = [row["met"] for row in rows if row["answer"] == "refused"]
    here = [row["met"] for row in rows if row["answer"] != "refused"]
    counts = (sum(here), len(here) - sum(here), sum(gone), len(gone) - sum(gone))
    yield line("flown", len(rows), *counts)
    yield ""
    yield from head("record", ("wanted wn, zeta", "answer", "off %, zeta", "reasons", "met"))
    for row in rows:
        cells = (row[name] for name in ("file", "wanted", "answer", "off", "why"))
        yield line(*cells, "yes" if row["met"] else "NO")
    failed = sum(not row["met"] for row in rows)
    return f"{failed} of {len(rows)} records do not meet their reference" if failed else None
