"""Child processes of tools and tests: each ends with its block, and none outlives its limit."""

from __future__ import annotations

import json
import math
import re
import subprocess
import sys
import threading
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

LIMIT_S = 120.0
"""Twenty times what the slowest child of a test needs alone on two cores."""
LONG_S = 86_400.0
"""For a child that measures for hours."""
LEAVE_S = 10.0
"""A session that is told to end finishes its files within a second or two."""


# A process begins with its parent's peak of memory: this small one between has none.
_MEASURE = """
import json, os, subprocess, sys, time
start = time.perf_counter()
process = subprocess.Popen(sys.argv[1:], stdout=subprocess.DEVNULL)
_, status, used = os.wait4(process.pid, 0)
spent = time.perf_counter() - start, used.ru_utime + used.ru_stime, used.ru_utime
print(json.dumps([os.waitstatus_to_exitcode(status), *spent, used.ru_maxrss / 1024]))
"""


@dataclass(frozen=True, slots=True)
class Cost:
    """What a process took, its children included: seconds, and its peak of memory in MB."""

    code: int
    wall_s: float
    cpu_s: float
    user_s: float
    peak_mb: float


def cost_of(
    *arguments: str, allowed: Collection[int] = (0,), env: Mapping[str, str] | None = None
) -> Cost:
    """Run Python with these arguments to its end; return what that took.

    Raises:
        SystemExit: it ended with a code that is not allowed.
    """
    command = [sys.executable, "-c", _MEASURE, sys.executable, *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=env)
    cost = Cost(*json.loads(done.stdout))
    if cost.code not in allowed:
        raise SystemExit(f"{' '.join(arguments)} ended with {cost.code}: {done.stderr.strip()}")
    return cost


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


def resident_mb(pid: int | str = "self") -> float:
    """Return the memory that a process holds now, without what it shares with files."""
    text = Path(f"/proc/{pid}/status").read_text()
    match = re.search(r"RssAnon:\s+(\d+) kB", text)
    return math.nan if match is None else int(match[1]) / 1024.0
