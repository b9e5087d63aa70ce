"""Runs all checks of a developer in the current environment: tests, format, lint, types, words.

    python tools/check.py [--fast | --long]

``--fast`` leaves out tests marked slow. ``--long`` adds tests marked long (two hours at most each),
500 examples where a test draws 25 of them, and check_install.py, which must pass before an issue is
closed; without ``.[dev,stores]`` the test of an S3 server is skipped. All checks run even if one
fails; the exit code is 1 then.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def commands(*, fast: bool = False, long: bool = False) -> list[list[str]]:
    """Return the command lines of the checks; the first runs the tests."""
    python = sys.executable
    tests = [python, "-m", "pytest", "-n", "2"]
    more = [
        [python, "-m", "pytest", "-m", "long", "-o", "faulthandler_timeout=7200"],
        [*tests, "-m", "hypothesis and not long", "--hypothesis-profile", "long"],
        [python, "tools/checks/check_install.py"],
    ]
    return [
        [*tests, "-m", "not slow and not long"] if fast else tests,
        *(more if long else []),
        [python, "-m", "ruff", "format", "--check", "."],
        [python, "-m", "ruff", "check", "."],
        [python, "-m", "mypy", "--strict", "src", "tools"],
        [python, "tools/checks/words.py"],
    ]


def main() -> bool:
    """Run all checks; return whether one failed."""
    parser = argparse.ArgumentParser(description=__doc__)
    which = parser.add_mutually_exclusive_group()
    which.add_argument("--fast", action="store_true", help="leave out the slow tests")
    which.add_argument("--long", action="store_true", help="add what the gate leaves out")
    os.environ["MPLBACKEND"] = "Agg"
    # Without kept bytecode, each child of a test would compile all modules that it imports.
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    codes = []
    for command in commands(**vars(parser.parse_args())):
        print("$", " ".join(["python", *command[1:]]), flush=True)
        codes.append(subprocess.run(command, cwd=ROOT, check=False).returncode)
    return any(codes)


if __name__ == "__main__":
    sys.exit(main())
