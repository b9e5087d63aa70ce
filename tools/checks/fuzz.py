"""Fuzzes yawid for a while: hostile logs and command lines through its own main.

    python -m checks.fuzz [--minutes 10] [--seed 0]

It looks for exceptions and warnings that escape, runs that do not end, undocumented exit codes,
errors of more than one line, and memory that grows. Every finding is printed once, reduced to a
small example that can be run again. The exit code is 1 if there is a finding.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import re
import signal
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Iterator
from pathlib import Path
from types import FrameType

import hypothesis
from hypothesis import HealthCheck, settings

from checks.children import resident_mb
from checks.fuzz_inputs import FuzzFlight, command_lines, flights
from yawid.cli.main import main as yawid

LONGEST_S = 20
EXIT_CODES = frozenset({0, 2, 3, 4, 5, 6})
_EXAMPLES = 60
_TOML = 'method = "rml"\nrate = 10.0\nmemory = 30\n'
_NOT_A_NUMBER = re.compile(r"\b(NaN|Infinity)\b")


class FindingError(Exception):
    """A run did something that it must not do."""


def run(flight: FuzzFlight, arguments: list[str], folder: Path) -> int:
    """Run one command line on one flight; return its exit code.

    Raises:
        FindingError: the run took too long, or ended with an output that a user cannot read.
        Exception: any exception that escaped from yawid.
    """
    files = {"LOG": folder / "log.tlog", "KEY": folder / "key", "TOML": folder / "run.toml"}
    files["OUT"] = folder / "out"
    files["LOG"].write_bytes(flight.tlog())
    files["KEY"].write_bytes(bytes(range(32)))
    files["TOML"].write_text(_TOML, encoding="utf-8")
    pattern = re.compile(r"(^|=)(LOG|KEY|TOML|OUT)$")
    given = [pattern.sub(lambda m: m[1] + str(files[m[2]]), word) for word in arguments]
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err), _limited():
        try:
            code = yawid(given)
        except SystemExit as end:  # argparse exits so
            return int(end.code or 0)
    _check(code, given, out.getvalue(), err.getvalue())
    return code


def _check(code: int, arguments: list[str], out: str, err: str) -> None:
    if code not in EXIT_CODES:
        raise FindingError(f"exit code {code}")
    if code in (2, 6) and arguments[0] != "live" and err.count("\n") > arguments.count("LOG") + 2:
        raise FindingError(f"more than one line for an error: {err!r}")
    if "--json" in arguments:
        for line in out.splitlines():
            if _NOT_A_NUMBER.search(line):
                raise FindingError(f"not JSON: {line}")
            json.loads(line)


def warm_up(folder: Path) -> None:
    """Import and compile everything, so that this does not count as time of a run."""
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        for engine in ("numba", "filterpy"):
            log = folder / "log.tlog"
            log.write_bytes(FuzzFlight(seconds=15.0).tlog())
            out = ["--out", str(folder / "out"), "--force"]
            yawid(["replay", str(log), f"--engine={engine}", *out])
            yawid(["orders", str(log)])


@contextlib.contextmanager
def _limited() -> Iterator[None]:
    """Raise FindingError if the block takes longer than LONGEST_S."""

    def too_long(number: int, frame: FrameType | None) -> None:
        raise FindingError(f"not finished after {LONGEST_S} s")

    before = signal.signal(signal.SIGALRM, too_long)
    signal.alarm(LONGEST_S)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def fuzz(seed: int, folder: Path, counts: dict[int, int], known: set[str]) -> str | None:
    """Run some examples; return the first finding that is not in ``known``, reduced in size.

    ``counts`` gets the number of runs by exit code, ``known`` the place of the finding.
    """

    @hypothesis.seed(seed)
    @settings(
        max_examples=_EXAMPLES,
        deadline=None,
        database=None,
        suppress_health_check=list(HealthCheck),
    )
    @hypothesis.given(flight=flights(), arguments=command_lines())
    def one(flight: FuzzFlight, arguments: list[str]) -> None:
        try:
            code = run(flight, arguments, folder)
        except Exception as error:
            if place(error) not in known:
                raise
        else:
            counts[code] = counts.get(code, 0) + 1

    try:
        one()
    except Exception as error:
        known.update(place(each) for each in getattr(error, "exceptions", [error]))
        return "".join(traceback.format_exception(error, limit=-4))
    return None


def place(error: BaseException) -> str:
    """Return the name of a finding: the kind of error and where it was raised."""
    last = traceback.extract_tb(error.__traceback__)[-1]
    return f"{type(error).__name__} at {Path(last.filename).name}:{last.lineno}"


def main() -> int:
    """Fuzz until the time is over; print the findings."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    warnings.simplefilter("error")
    end = time.monotonic() + 60.0 * arguments.minutes
    counts: dict[int, int] = {}
    known: set[str] = set()
    seed, memory_mb = arguments.seed, []
    with tempfile.TemporaryDirectory() as folder:
        warm_up(Path(folder))
        while time.monotonic() < end:
            found = fuzz(seed, Path(folder), counts, known)
            if found is not None:
                print(f"--- seed {seed}\n{found}", flush=True)
            memory_mb.append(resident_mb())
            seed += 1
    counted = ", ".join(f"exit {code}: {count}" for code, count in sorted(counts.items()))
    print(f"{sum(counts.values())} runs ({counted}); findings: {sorted(known) or 'none'}")
    quarter = memory_mb[len(memory_mb) // 4]
    print(f"resident memory: {quarter:.0f} MB after a quarter, {memory_mb[-1]:.0f} MB at the end")
    return 1 if known else 0


if __name__ == "__main__":
    sys.exit(main())
