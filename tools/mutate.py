"""Seed small defects one at a time in a copy of the tree, and see whether the tests notice.

    python tools/mutate.py                # all of tools/defects.py, a Markdown table at the end
    python tools/mutate.py --only jury    # those whose description holds a word
    python tools/mutate.py --check        # only see that each pattern stands where it should

A defect is caught when a test of its own part fails; where none does, the whole suite (without the
slow tests) decides. Before anything is changed each part must pass as it is.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from defects import DEFECTS, Defect

ROOT = Path(__file__).resolve().parents[1]
COPIED = ("src", "tests", "tools", "replay_logs")
TIMEOUT_S = 900


class Copy:
    """A copy of the tree to be spoiled; numba's cache in it survives from defect to defect."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        ignored = shutil.ignore_patterns("__pycache__", "*.egg-info", "actual.*")
        for name in COPIED:
            shutil.copytree(ROOT / name, folder / name, ignore=ignored)
        shutil.copy2(ROOT / "pyproject.toml", folder)

    def failing(self, tests: Sequence[str]) -> str:
        """Return the first test that fails, "" where all pass."""
        command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider"]
        command += ["-m", "not slow", *tests]
        environment = os.environ | {"PYTHONPATH": str(self.folder / "src"), "MPLBACKEND": "Agg"}
        try:
            done = subprocess.run(
                command,
                cwd=self.folder,
                env=environment,
                capture_output=True,
                text=True,
                check=False,
                timeout=TIMEOUT_S,
            )
        except subprocess.TimeoutExpired:
            return f"no end within {TIMEOUT_S} s"
        if done.returncode == 0:
            return ""
        told = [line for line in done.stdout.splitlines() if line.startswith(("FAILED", "ERROR"))]
        return told[0].split(" - ")[0] if told else f"pytest ended with {done.returncode}"

    def caught_by(self, defect: Defect, suite: Sequence[str]) -> str:
        """Return the test that notices the defect, "" where none does."""
        path = self.folder / "src" / "yawid" / defect.file
        kept = path.with_suffix(".kept")
        shutil.copy2(path, kept)
        try:
            text = path.read_text(encoding="utf-8")
            path.write_text(text.replace(defect.old, defect.new), encoding="utf-8")
            return self.failing(defect.tests) or self.failing(suite)
        finally:
            # The old time too: numba and Python know their caches by it.
            shutil.move(kept, path)


def misplaced(defects: Sequence[Defect]) -> list[str]:
    """Return the defects whose pattern does not stand exactly once in its file."""
    found = []
    for defect in defects:
        count = (ROOT / "src" / "yawid" / defect.file).read_text(encoding="utf-8").count(defect.old)
        if count != 1:
            found.append(f"{defect.what}: {count} times in {defect.file}: {defect.old!r}")
    return found


def run(defects: Sequence[Defect], suite: Sequence[str], folder: Path) -> list[tuple[Defect, str]]:
    """Return each defect with the test that caught it, "" for a missed one.

    Raises:
        RuntimeError: a part of the suite fails before anything was changed.
    """
    copy = Copy(folder)
    for tests in sorted({defect.tests for defect in defects}):
        if failed := copy.failing(tests):
            raise RuntimeError(f"fails without any defect: {failed}")
    results = []
    for number, defect in enumerate(defects, 1):
        began = time.monotonic()
        caught = copy.caught_by(defect, suite)
        results.append((defect, caught))
        verdict = f"caught by {caught.removeprefix('FAILED ')}" if caught else "MISSED"
        seconds = time.monotonic() - began
        print(f"{number:2} {defect.what}: {verdict} ({seconds:.0f} s)", file=sys.stderr, flush=True)
    return results


def main(argv: Sequence[str]) -> int:
    """Seed the defects; return 0 where all but one are caught, else 1, or 2 where none can be."""
    parser = argparse.ArgumentParser(prog="mutate.py", description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--only", metavar="WORD", default="", help="defects that speak of it")
    parser.add_argument("--check", action="store_true", help="only look for the patterns")
    parser.add_argument(
        "--suite", nargs="*", default=["tests"], help="what decides at last (tests)"
    )
    options = parser.parse_args(argv)
    defects = [defect for defect in DEFECTS if options.only.lower() in defect.what.lower()]
    if wrong := misplaced(defects):
        print("mutate: " + "\nmutate: ".join(wrong), file=sys.stderr)
        return 2
    if options.check:
        return 0
    with tempfile.TemporaryDirectory() as scratch:
        try:
            results = run(defects, options.suite, Path(scratch) / "tree")
        except RuntimeError as error:
            print(f"mutate: {error}", file=sys.stderr)
            return 2
    print("| defect | file | caught by |\n|---|---|---|")
    for defect, caught in results:
        told = caught.removeprefix("FAILED ").removeprefix("ERROR ") or "**missed**"
        print(f"| {defect.what} | {defect.file} | {told} |")
    missed = sum(not caught for _, caught in results)
    print(f"\n{len(results) - missed} of {len(results)} caught", flush=True)
    return 0 if missed <= 1 else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
