"""Replays all cases with two commits on this machine, and says what differs in any bit.

    python -m cases.two_commits OLD [NEW] [--cases c172p_3211 ...]

NEW is this tree if it is not given. Each log is replayed with the case's options and with the
default ones, by the command line of each commit; what is compared is what is printed as JSON, the
exit code, and each topic of the MCAP, message by message. The cases and this file are those of this
tree. The exit code is 1 if anything differs.
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
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from mcap.reader import make_reader

ROOT = Path(__file__).resolve().parents[2]
CASES = ROOT / "replay_logs"
OF_THE_DISK = ("log", "files")
"""Keys of the printed JSON that have paths."""


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


def printed(
    tree: Path, log: Path, given: Sequence[str], folder: Path | None = None
) -> tuple[int, dict[str, Any]]:
    """Replay a log by the command line of a tree; return the exit code and the JSON printed.

    The options are ``given``; the files go to ``folder``, or are deleted. If nothing was printed,
    ``error`` is what was said on stderr.
    """
    with tempfile.TemporaryDirectory() as scratch:
        out = folder or Path(scratch)
        line = ["replay", str(log.resolve()), "--json", "--out", str(out), *given]
        done = subprocess.run(
            [sys.executable, "-m", "yawid", *line],
            env=os.environ | {"PYTHONPATH": str(tree / "src")}, cwd=out,
            capture_output=True, check=False, encoding="utf-8", timeout=600,
        )  # fmt: skip
    return done.returncode, json.loads(done.stdout or "null") or {"error": done.stderr}


def answer(found: dict[str, Any]) -> tuple[dict[str, Any], dict[str, Any] | None]:
    """Return the verdict that decides, of JSON printed, and the Dutch roll if it may be used.

    They are the flight's, or the run's if no manoeuvre was found; where nothing was judged, the
    verdict is empty. In older versions a run without a manoeuvre had the stream's answer.
    """
    of = found.get("flight") or found
    verdict: dict[str, Any] = of.get("verdict") or {}
    if of is found and verdict.get("usable"):
        of = found["estimates"][verdict["method"]]
    return verdict, of.get("dutch_roll") if verdict.get("usable") else None


def _topics(path: Path) -> dict[str, str]:
    """Return for each topic the number of its messages and a digest of their times and bytes."""
    digests, counts = dict[str, Any](), dict[str, int]()
    with path.open("rb") as file:
        for _, channel, message in make_reader(file).iter_messages():
            digest = digests.setdefault(channel.topic, hashlib.sha256())
            digest.update(message.log_time.to_bytes(8, "little") + message.data)
            counts[channel.topic] = counts.get(channel.topic, 0) + 1
    return {name: f"{counts[name]} messages, {of.hexdigest()}" for name, of in digests.items()}


def differences(old: dict[Any, Any], new: dict[Any, Any], where: str = "") -> Iterator[str]:
    """Yield the names of what differs, followed down to the last key of JSON."""
    for name in dict.fromkeys([*old, *new]):
        one, other = old.get(name), new.get(name)
        if isinstance(one, dict) and isinstance(other, dict):
            yield from differences(one, other, f"{where}{name}.")
        elif isinstance(one, list) and isinstance(other, list) and len(one) == len(other):
            some, others = dict(enumerate(one)), dict(enumerate(other))
            yield from differences(some, others, f"{where}{name}.")
        elif repr(one) != repr(other):
            yield f"{where}{name}: {repr(one)[:80]}, {repr(other)[:80]}"


def main(arguments: Sequence[str]) -> int:
    """Print what differs, case by case; return 1 if anything does."""
    parser = argparse.ArgumentParser(prog="cases.two_commits", description=__doc__)
    parser.add_argument("old")
    parser.add_argument("new", nargs="?")
    parser.add_argument("--cases", nargs="+", default=[])
    options = parser.parse_args(arguments)
    count = 0
    with tempfile.TemporaryDirectory() as folder:
        trees = [tree_of(commit, Path(folder) / str(n)) for n, commit in
                 enumerate((options.old, options.new))]  # fmt: skip
        for path in sorted(CASES.glob("*/case.toml")):
            if options.cases and path.parent.name not in options.cases:
                continue
            old, new = (answers(tree, path.parent) for tree in trees)
            found = list(differences(old, new))
            print(f"{path.parent.name}: {'same' if not found else ''}", *found, sep="\n    ")
            count += bool(found)
    return int(count > 0)


def tree_of(commit: str | None, folder: Path) -> Path:
    """Return a folder with the sources of a commit; this tree if it is None."""
    if commit is None:
        return ROOT
    folder.mkdir()
    packed = subprocess.run(
        ["git", "archive", commit, "src"], cwd=ROOT, capture_output=True, check=True
    )
    subprocess.run(["tar", "-x"], cwd=folder, input=packed.stdout, check=True)
    return folder


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
