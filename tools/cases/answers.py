"""Writes a table of the answers of many flights, and says what differs from an earlier table.

    python -m cases.answers TABLE.csv [FOLDER ...] [--commit OLD] [--against OLD.csv] [--jobs 1]

A row is a log of a folder (tlog, dataflash or ULog, also in folders below it), replayed with the
default options by the command line of a commit, or of this tree. Such folders are replay_logs, one
of recorded flights, and those in which a bench keeps its flights (``bench.py truth --logs DIR``).
Without a folder, TABLE.csv is read. With ``--against`` the two tables are compared: first how many
flights changed in which way, then which. The exit code is 1 if any did, or if the tables have not
the same flights.
"""

from __future__ import annotations

import argparse
import csv
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path

from bench.table import Row, head, in_processes, line, write_csv

from cases.two_commits import answer, printed, tree_of

LOGS = {".tlog", ".bin", ".ulg"}
NUMBERS = ("wn", "zeta")
STEPS = (0.1, 1.0)
"""A number that moved is counted up to each of these shares of its earlier sigma, and above."""
Table = Mapping[str, Mapping[str, str]]
"""The rows of a table by the names of the logs, as text."""


def row_of(tree: Path, task: tuple[Path, str]) -> list[Row]:
    """Return the row of a log, which has a number for wn and zeta only if they may be used."""
    log, name = task
    code, found = printed(tree, log, [])
    verdict, roll = answer(found)
    made = found.get("manoeuvres") or []
    row: Row = {"log": name, "exit_code": code, "usable": bool(verdict.get("usable"))}
    values = roll or {}
    row |= {"wn": values.get("wn_rad_s"), "wn_std": values.get("wn_std")}
    row |= {"zeta": values.get("zeta"), "zeta_std": values.get("zeta_std")}
    row["reasons"] = " ".join(reason["id"] for reason in verdict.get("reasons", ()))
    usable = sum(bool(each["verdict"]["usable"]) for each in made)
    return [row | {"manoeuvres": len(made), "usable_manoeuvres": usable}]


def logs_of(folder: Path) -> list[tuple[Path, str]]:
    """Return the logs of a folder and their names, which begin with the folder's."""
    found = sorted(path for path in folder.rglob("*") if path.suffix.lower() in LOGS)
    return [(path, f"{folder.resolve().name}/{path.relative_to(folder)}") for path in found]


def read(path: Path) -> Table:
    """Return a table that was written."""
    with path.open(newline="", encoding="utf-8") as file:
        return {row["log"]: row for row in csv.DictReader(file)}


def moved(old: Mapping[str, str], new: Mapping[str, str], name: str) -> tuple[float, str] | None:
    """Return by how many of its earlier sigmas a number moved, and this in words; None if equal.

    A number that only one of the rows has, or whose sigma was 0, moved by infinitely many.
    """
    was, now = old[name], new[name]
    if (was, old[f"{name}_std"]) == (now, new[f"{name}_std"]):
        return None
    said = f"{name} {was or 'none'}±{old[f'{name}_std']} to {now or 'none'}±{new[f'{name}_std']}"
    if not was or not now:
        return float("inf"), said
    step, sigma = float(now) - float(was), float(old[f"{name}_std"] or 0.0)
    sigmas = abs(step) / sigma if sigma else float("inf")
    return sigmas, f"{said} ({100.0 * step / float(was):+.2f} %, {sigmas:.2f} sigma)"


def changed(old: Mapping[str, str], new: Mapping[str, str]) -> Iterator[tuple[str, str]]:
    """Yield each way in which a flight's row changed, and the change in words."""
    if (was := old["exit_code"]) != (now := new["exit_code"]):
        yield f"exit code {was} to {now}", f"exit code {was} to {now}"
    if (gone := old["reasons"]) != (come := new["reasons"]):
        yield "other reasons", f"{gone or 'no reasons'} to {come or 'no reasons'}"
    for name in NUMBERS:
        if (of := moved(old, new, name)) is not None:
            far = next((f"by at most {step:g} sigma" for step in STEPS if of[0] <= step), "more")
            both = old[name] and new[name]
            yield f"{name} moved {far}" if both else f"{name} came or went", of[1]
    for name in ("manoeuvres", "usable_manoeuvres"):
        if old[name] != new[name]:
            yield f"number of {name}", f"{old[name]} to {new[name]} {name}"


def comparison(old: Table, new: Table) -> Iterator[str]:
    """Yield the counts of changes by their kind, then the flights that changed."""
    both = [log for log in old if log in new]
    ways = {log: list(changed(old[log], new[log])) for log in both}
    counts = Counter(way for each in ways.values() for way, _ in each)
    yield from head("change", ("flights",))
    yield line("none", sum(not each for each in ways.values()))
    for way in sorted(counts):
        yield line(way, counts[way])
    for where, other, rows in (("earlier", new, old), ("later", old, new)):
        if only := [log for log in rows if log not in other]:
            yield line(f"only in the {where} table: {' '.join(only)}", len(only))
    yield ""
    for log, each in ways.items():
        if each:
            yield f"{log}: {'; '.join(said for _, said in each)}"


def main(arguments: Sequence[str]) -> int:
    """Write the table of the folders, and compare it if asked; return 1 if anything differs."""
    parser = argparse.ArgumentParser(prog="cases.answers", description=__doc__)
    parser.add_argument("table", type=Path)
    parser.add_argument("folders", type=Path, nargs="*")
    parser.add_argument("--commit")
    parser.add_argument("--against", type=Path)
    parser.add_argument("--jobs", type=int, default=1)
    options = parser.parse_args(arguments)
    if options.folders:
        logs = [each for folder in options.folders for each in logs_of(folder)]
        with tempfile.TemporaryDirectory() as scratch:
            tree = tree_of(options.commit, Path(scratch) / "tree")
            write_csv(options.table, in_processes(partial(row_of, tree), logs, options.jobs))
    if not options.against:
        return 0
    old, new = read(options.against), read(options.table)
    print(*comparison(old, new), sep="\n")
    return int(old.keys() != new.keys() or any([*changed(old[log], new[log])] for log in old))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
