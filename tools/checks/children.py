"""Child processes of tools and tests: each ends with its block, and none outlives its limit."""

from __future__ import annotations

import subprocess
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

LIMIT_S = 120.0
"""Twenty times what the slowest child of a test needs alone on two cores."""
LONG_S = 86_400.0
"""For a child that measures for hours."""
LEAVE_S = 10.0
"""A session that is told to end finishes its files within a second or two."""


@contextmanager
def child(
    command: Sequence[str | Path], within_s: float = LIMIT_S, **options: Any
) -> Iterator[subprocess.Popen[Any]]:
    """Start a process and end it with the block; kill it where it lives for ``within_s``.

    So whoever reads its pipes or waits for it goes on after that time at the latest.
    """
    process = subprocess.Popen(command, **options)
    late = threading.Timer(within_s, process.kill)
    late.daemon = True
    late.start()
    try:
        yield process
    finally:
        late.cancel()
        end(process)


def end(process: subprocess.Popen[Any]) -> None:
    """End a process by SIGTERM, by SIGKILL where it does not heed that; close its pipes.

    SIGINT would not do: a shell starts a job in the background with SIGINT ignored.
    """
    process.terminate()
    try:
        process.wait(LEAVE_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait(LEAVE_S)
    for stream in (process.stdin, process.stdout, process.stderr):
        if stream is not None:
            with suppress(OSError):  # what it never read
                stream.close()
