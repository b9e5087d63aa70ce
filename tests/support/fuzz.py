"""Runs hostile logs and command lines through yawid's own main, and looks for what no run may do.

That is an exception or a warning that escapes, a run that does not end, an undocumented exit code,
or an error of more than one line. tests/test_fuzz.py draws the inputs; the long list
draws 20 times as many.
"""

from __future__ import annotations

import contextlib
import io
import json
import re
import signal
from collections.abc import Iterator
from pathlib import Path
from types import FrameType

from fuzz_inputs import FuzzFlight

from yawid.cli.main import main as yawid

LONGEST_S = 20
EXIT_CODES = frozenset({0, 2, 3, 4, 5, 6})
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
        log = folder / "log.tlog"
        log.write_bytes(FuzzFlight(seconds=15.0).tlog())
        yawid(["replay", str(log), "--out", str(folder / "out"), "--force"])
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
