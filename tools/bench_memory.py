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


def peak_mb(log: Path, out: Path, rerun: str) -> tuple[int, float]:
    """Return exit code and peak resident memory in MB of a replay in its own process."""
    command = ["replay", str(log), "--out", str(out), "--force", "--json", "--rerun", rerun]
    timed = [sys.executable, "-c", _TIMED, sys.executable, "-m", "yawid", *command]
    done = subprocess.run(timed, capture_output=True, text=True, check=True)
    code, _, _, peak = json.loads(done.stdout)
    return code, peak


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


def main(arguments: list[str]) -> None:
    """Print a line for each log: its size, the exit code and the peak to MCAP, and with an .rrd."""
    parser = argparse.ArgumentParser(prog="bench.py memory", description=__doc__)
    parser.add_argument("logs", nargs="*", type=Path, metavar="LOG")
    parser.add_argument("--size", type=float, default=20.0, metavar="MB")
    options = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for log in [*options.logs, *made(folder, options.size)]:
            (code, plain), (_, shown) = (
                peak_mb(log, folder / "out", rerun) for rerun in ("off", "save")
            )
            size = log.stat().st_size / 1e6
            print(
                f"{log.name:32s} {size:6.1f} MB, exit {code}: "
                f"{plain:.0f} MB, {shown:.0f} with .rrd",
                flush=True,
            )
