"""Runs yawid in a process that gets a real signal after so many blocks of samples."""

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
SLOW_TO_END = """
import sys, time
from yawid.cli import main as cli
from yawid.runs.live import loop
def slow(self):
    print('finishing', flush=True)
    time.sleep(60)
loop._Loop.finish = slow
sys.exit(cli.main(sys.argv[1:]))
"""
"""A live session that takes a minute to finish, and says when it begins to."""


def yawid_with(signal: str, at: int, *arguments: object) -> subprocess.CompletedProcess[str]:
    """Run a command that gets the signal before its ``at``-th block of samples is estimated."""
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
    """Write a log many times into one file, each time as another boot, until it is so large.

    A log is read a megabyte at a time, so that it has several blocks then.
    """
    data = log.read_bytes()
    out.write_bytes(data * (megabytes * 1_000_000 // len(data) + 1))
    return out
