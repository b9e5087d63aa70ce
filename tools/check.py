"""The one command a developer runs: tests, format, lint, types, in the environment at hand.

    python tools/check.py [--fast]

``--fast`` leaves out what is marked slow or mutation. All of them run; the exit code is that of the
first that fails.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
TYPED = ("src", "tools")


def commands(fast: bool) -> list[list[str]]:
    """Return the command lines; the first is the README's own test command."""
    python = sys.executable
    tests = [python, "-m", "pytest", "-n", "2"]
    return [
        [*tests, "-m", "not slow and not mutation"] if fast else tests,
        [python, "-m", "ruff", "format", "--check", "."],
        [python, "-m", "ruff", "check", "."],
        [python, "-m", "mypy", "--strict", *TYPED],
    ]


def main() -> int:
    """Run them all; return the first exit code that is not zero."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--fast", action="store_true", help="leave out the slow tests")
    codes = []
    for command in commands(parser.parse_args().fast):
        print("$", " ".join(["python", *command[1:]]), flush=True)
        environment = os.environ | {"MPLBACKEND": "Agg"}
        codes.append(subprocess.run(command, cwd=ROOT, env=environment, check=False).returncode)
    return next((code for code in codes if code), 0)


if __name__ == "__main__":
    sys.exit(main())
