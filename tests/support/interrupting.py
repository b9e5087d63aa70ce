"""A yawid of its own that gets a real signal while it reads: after so many blocks of a log."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

SCRIPT = """
import os, signal, sys
from yawid import pipeline
from yawid.cli import main as cli
name, at = sys.argv[1], int(sys.argv[2])
count, estimate = 0, pipeline.Pipeline.estimate
def signalled(self, samples):
    global count
    count += 1
    if count == at:
        os.kill(os.getpid(), getattr(signal, name))
    estimate(self, samples)
pipeline.Pipeline.estimate = signalled
sys.exit(cli.main(sys.argv[3:]))
"""


def yawid_with(signal: str, at: int, *arguments: object) -> subprocess.CompletedProcess[str]:
    """Run a command that gets the signal as its ``at``-th block of samples is estimated."""
    command = [sys.executable, "-W", "error", "-c", SCRIPT, signal, str(at)]
    return subprocess.run(
        [*command, *map(str, arguments)],
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
    )


def repeated(log: Path, out: Path, megabytes: int) -> Path:
    """Write a log again and again, each time another boot: a log is read a megabyte at a time."""
    data = log.read_bytes()
    out.write_bytes(data * (megabytes * 1_000_000 // len(data) + 1))
    return out
