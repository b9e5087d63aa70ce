"""The peak memory of ``yawid replay``, whole process, on logs given and on content made to hurt.

    python tools/bench.py memory [LOG ...] [--size MB]

What is made: telemetry as a plane sends it, noise, magics and heads of frames over and over.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from bench_replay import _TIMED
from long_log import write_log

HURTS = {
    "noise.tlog": np.random.default_rng(2).bytes(1 << 20),
    "magics_1.tlog": b"\xfe" * 1000,
    "magics_2.tlog": b"\xfd" * 1000,
    "heads.tlog": b"\xfe\x1c\x00\x01\x01\x1e",
}


def peak_mb(log: Path, out: Path, rerun: str) -> float:
    """Return the peak resident memory in MB of a replay in its own process."""
    command = ["replay", str(log), "--out", str(out), "--force", "--json", "--rerun", rerun]
    timed = [sys.executable, "-c", _TIMED, sys.executable, "-m", "yawid", *command]
    done = subprocess.run(timed, capture_output=True, text=True, check=True)
    peak: float = json.loads(done.stdout)[3]
    return peak


def made(folder: Path, size_mb: float) -> Iterator[Path]:
    """Write the logs that are made: some good telemetry first, so that there is a vehicle."""
    good = folder / "telemetry.tlog"
    write_log(good, size_mb / 30.0, "raised")
    yield good
    head = good.read_bytes()[: 1 << 20]
    for name, content in HURTS.items():
        path = folder / name
        path.write_bytes(head + content * round(1e6 * size_mb / len(content)))
        yield path


def kind(log: Path, is_made: bool) -> str:
    """Return the row that a log belongs to."""
    if not is_made:
        return "recorded flights"
    return (
        "noise, magics, heads of frames" if log.name in HURTS else "telemetry as a plane sends it"
    )


def span(values: list[float], digits: int = 0) -> str:
    """Return the range of values."""
    low, high = f"{min(values):.{digits}f}", f"{max(values):.{digits}f}"
    return low if low == high else f"{low} to {high}"


def main(arguments: list[str]) -> Iterator[str]:
    """Yield a row for each kind of log: sizes and peaks, to MCAP and with an .rrd."""
    parser = argparse.ArgumentParser(prog="bench.py memory", description=__doc__)
    parser.add_argument("logs", nargs="*", type=Path, metavar="LOG")
    parser.add_argument("--size", type=float, default=20.0, metavar="MB")
    options = parser.parse_args(arguments)
    found: dict[str, list[tuple[float, float, float]]] = {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for log in [*options.logs, *made(folder, options.size)]:
            plain, shown = (peak_mb(log, folder / "out", rerun) for rerun in ("off", "save"))
            row = (log.stat().st_size / 1e6, plain, shown)
            found.setdefault(kind(log, log.parent == folder), []).append(row)
    yield "| | logs | size, MB | peak to MCAP, MB | and .rrd |"
    yield "|---|---|---|---|---|"
    for what, rows in found.items():
        size, plain_mb, shown_mb = (list(column) for column in zip(*rows, strict=True))
        yield (f"| {what} | {len(rows)} | {span(size, 1)} | {span(plain_mb)} | {span(shown_mb)} |")
