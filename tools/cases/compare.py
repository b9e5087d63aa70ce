"""Replays logs with two commits on this machine, and says what differs.

    python -m cases.compare OLD [NEW] [--cases c172p_3211 ...]
    python -m cases.compare OLD [NEW] --logs FOLDER ... [--jobs 1]

NEW is this tree if it is not given. Each case is replayed with its options and with the default
ones, by the command line of each commit; what is compared, in any bit, is what is printed as JSON,
the exit code, and each topic of the MCAP, message by message. The logs of a folder (tlog, dataflash
or ULog, also in folders below it, such as those of ``bench.py truth --logs DIR``) are replayed with
the default options; of them it is said how many changed in which way, and then which. The exit code
is 1 if anything differs.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import subprocess
import sys
import tempfile
import tomllib
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from bench.frame import Row, head, in_processes, line
from mcap.reader import make_reader

ROOT = Path(__file__).resolve().parents[2]
OF_THE_DISK = ("log", "files")
"""Keys of the printed JSON that have paths."""
LOGS = {".tlog", ".bin", ".ulg"}
NUMBERS = {"wn": "wn_rad_s", "zeta": "zeta"}
STEPS = (0.1, 1.0)
"""A number that moved is counted up to each of these shares of its earlier sigma, and above."""


def tree_of(commit: str | None, folder: Path) -> Path:
    """Return a folder with the sources of a commit; this tree if it is None."""
    if commit is None:
        return ROOT
    folder.mkdir()
    asked = ["git", "archive", commit, "src"]
    packed = subprocess.run(asked, cwd=ROOT, capture_output=True, check=True)
    subprocess.run(["tar", "-x"], cwd=folder, input=packed.stdout, check=True)
    return folder


def printed(
    tree: Path, log: Path, given: Sequence[str] = (), folder: Path | None = None
) -> tuple[int, dict[str, Any]]:
    """Replay a log by the command line of a tree; return the exit code and the JSON printed.

    The options are ``given``; the files go to ``folder``, or are deleted. If nothing was printed,
    ``error`` is what was said on stderr.
    """
    with tempfile.TemporaryDirectory() as scratch:
        out = folder or Path(scratch)
        asked = ["replay", str(log.resolve()), "--json", "--out", str(out), *given]
        done = subprocess.run(
            [sys.executable, "-m", "yawid", *asked],
            env=os.environ | {"PYTHONPATH": str(tree / "src")}, cwd=out,
            capture_output=True, check=False, encoding="utf-8", timeout=600,
        )  # fmt: skip
    return done.returncode, json.loads(done.stdout or "null") or {"error": done.stderr}


def answers(tree: Path, case: Path) -> dict[str, Any]:
    """Return what a tree's yawid makes of a case: its JSON by keys, digests of topics by name.

    Keys begin with ``options`` or ``flight``, the table of case.toml with the options.
    """
    toml = tomllib.loads((case / "case.toml").read_text(encoding="utf-8"))
    found: dict[str, Any] = {}
    for table in ("options", "flight"):
        with tempfile.TemporaryDirectory() as folder:
            given = [f"--{key.replace('_', '-')}={x}" for key, x in toml.get(table, {}).items()]
            code, said = printed(tree, case / "log.tlog", given, Path(folder))
            found[f"{table}.exit_code"] = code
            found |= {f"{table}.{k}": x for k, x in said.items() if k not in OF_THE_DISK}
            for path in Path(folder).glob("*.mcap"):
                found |= {f"{table} {topic}": of for topic, of in _topics(path).items()}
    return found


def _topics(path: Path) -> dict[str, str]:
    """Return for each topic a digest of the times and the bytes of its messages."""
    digests: dict[str, Any] = defaultdict(hashlib.sha256)
    with path.open("rb") as file:
        for _, channel, message in make_reader(file).iter_messages():
            digests[channel.topic].update(message.log_time.to_bytes(8, "little") + message.data)
    return {name: of.hexdigest() for name, of in digests.items()}


def differences(old: dict[Any, Any], new: dict[Any, Any], where: str = "") -> Iterator[str]:
    """Yield the names of what differs, followed down to the last key of JSON."""
    for name in dict.fromkeys([*old, *new]):
        one, other = (dict(enumerate(each)) if isinstance(each, list) else each
                      for each in (old.get(name), new.get(name)))  # fmt: skip
        if isinstance(one, dict) and isinstance(other, dict):
            yield from differences(one, other, f"{where}{name}.")
        elif repr(one) != repr(other):
            yield f"{where}{name}: {repr(one)[:80]}, {repr(other)[:80]}"


def row_of(code: int, found: dict[str, Any]) -> Row:
    """Return what counts of an answer: wn and zeta with their sigmas only if they may be used."""
    of = found.get("flight") or found
    verdict = of.get("verdict") or {}
    roll = (of.get("dutch_roll") if verdict.get("usable") else None) or {}
    made = found.get("manoeuvres") or []
    row: Row = {name: (roll.get(key), roll.get(f"{name}_std")) for name, key in NUMBERS.items()}
    return row | {
        "exit code": code,
        "reasons": " ".join(reason["id"] for reason in verdict.get("reasons", ())) or "none",
        "usable of manoeuvres": (sum(bool(m["verdict"]["usable"]) for m in made), len(made)),
    }


def changed(old: Row, new: Row) -> Iterator[tuple[str, str]]:
    """Yield each way in which a log's row changed, and the change in words."""
    for name, was in old.items():
        if was == (now := new[name]):
            continue
        way, said = f"other {name}", f"{name} {was} to {now}"
        if name in NUMBERS and None in (was[0], now[0]):
            way = f"{name} came or went"
        elif name in NUMBERS:
            step = now[0] - was[0]
            sigmas = abs(step) / was[1] if was[1] else float("inf")
            far = next((f"by at most {each:g} sigma" for each in STEPS if sigmas <= each), "more")
            way = f"{name} moved {far}"
            said = f"{said} ({100.0 * step / was[0]:+.2f} %, {sigmas:.2f} sigma)"
        yield way, said


def comparison(ways: dict[str, list[tuple[str, str]]]) -> Iterator[str]:
    """Yield the counts of changes by their kind, then the logs that changed, by name."""
    yield from head("change", ("logs",))
    yield line("none", sum(not each for each in ways.values()))
    counts = Counter(way for each in ways.values() for way, _ in each)
    yield from (line(way, counts[way]) for way in sorted(counts))
    yield ""
    yield from (
        f"{log}: {'; '.join(said for _, said in each)}" for log, each in ways.items() if each
    )


def _rows(trees: Sequence[Path], log: Path) -> list[Row]:
    return [{"log": str(log), "rows": [row_of(*printed(tree, log)) for tree in trees]}]


def main(arguments: Sequence[str]) -> int:
    """Print what differs, case by case or log by log; return 1 if anything does."""
    parser = argparse.ArgumentParser(prog="cases.compare", description=__doc__)
    parser.add_argument("old")
    parser.add_argument("new", nargs="?")
    parser.add_argument("--cases", nargs="+", default=[])
    parser.add_argument("--logs", nargs="+", type=Path, metavar="FOLDER", default=[])
    parser.add_argument("--jobs", type=int, default=1)
    options = parser.parse_args(arguments)
    found = {path for folder in options.logs for path in folder.rglob("*")}
    logs = sorted(path for path in found if path.suffix.lower() in LOGS)
    cases = [] if logs else sorted(path.parent for path in ROOT.glob("replay_logs/*/case.toml"))
    count = 0
    with tempfile.TemporaryDirectory() as scratch:
        trees = [tree_of(commit, Path(scratch) / str(n)) for n, commit in
                 enumerate((options.old, options.new))]  # fmt: skip
        rows = in_processes(partial(_rows, trees), logs, options.jobs)
        for case in cases:
            if not options.cases or case.name in options.cases:
                old, new = (answers(tree, case) for tree in trees)
                differ = list(differences(old, new))
                print(f"{case.name}: {'same' if not differ else ''}", *differ, sep="\n    ")
                count += bool(differ)
    if logs:
        ways = {row["log"]: list(changed(*row["rows"])) for row in rows}
        print(*comparison(ways), sep="\n")
        count += any(ways.values())
    return int(count > 0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
