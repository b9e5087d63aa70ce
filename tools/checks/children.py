"""Child processes of tools and tests: each ends with its ``with`` block or at its time limit."""

from __future__ import annotations

import json
import math
import re
import socket
import subprocess
import sys
import threading
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

LIMIT_S = 120.0
"""Time limit of a child in s: twenty times what the slowest child of a test needs on two cores."""
LONG_S = 86_400.0
"""Time limit in s of a child that measures for hours."""
LEAVE_S = 10.0
"""Time in s that a child has to end after SIGTERM; a session finishes its files in about two."""


# A process starts with the peak memory of its parent. This small process between keeps it low.
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
    """What a process cost, with its children: exit code, times in s, and peak memory in MB."""

    code: int
    wall_s: float
    cpu_s: float
    user_s: float
    peak_mb: float


def cost_of(
    *arguments: str, allowed: Collection[int] = (0,), env: Mapping[str, str] | None = None
) -> Cost:
    """Run Python with these arguments to its end; return what it cost.

    Raises:
        SystemExit: it ended with an exit code that is not in ``allowed``.
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
    """Start a process and end it with the block; kill it if it still runs after ``within_s`` s.

    So code that reads its pipes or waits for it cannot block for longer.
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
    """End a process by SIGTERM, or by SIGKILL if it ignores that; close its pipes.

    SIGINT does not suffice, as a shell starts background jobs with SIGINT ignored.
    """
    process.terminate()
    try:
        process.wait(LEAVE_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait(LEAVE_S)
    for stream in (process.stdin, process.stdout, process.stderr):
        if stream is not None:
            with suppress(OSError):  # closing flushes what the process never read
                stream.close()


def free_udp_port() -> int:
    """Return a free UDP port of this machine."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


def resident_mb(pid: int | str = "self") -> float:
    """Return the memory in MB that a process has now, without pages that belong to files."""
    text = Path(f"/proc/{pid}/status").read_text(encoding="utf-8")
    match = re.search(r"RssAnon:\s+(\d+) kB", text)
    return math.nan if match is None else int(match[1]) / 1024.0
