"""Child processes of tools and tests: each ends with its ``with`` block or at its time limit."""

from __future__ import annotations

import resource
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple

LIMIT_S = 120.0
"""Time limit of a child in s: twenty times what the slowest child of a test needs on two cores."""
LONG_S = 86_400.0
"""Time limit in s of a child that measures for hours."""
LEAVE_S = 10.0
"""Time in s that a child has to end after SIGTERM; a session finishes its files in about two."""


class Cost(NamedTuple):
    """What a process cost, with its children, in s."""

    wall_s: float
    cpu_s: float


def cost_of(
    *arguments: str, allowed: Collection[int] = (0,), env: Mapping[str, str] | None = None
) -> Cost:
    """Run Python with these arguments to its end; return what it cost.

    Raises:
        SystemExit: it ended with an exit code that is not in ``allowed``.
    """
    start_s, before = time.perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(
        [sys.executable, *arguments], stdout=subprocess.DEVNULL, check=False, env=env
    )
    if done.returncode not in allowed:
        raise SystemExit(f"{' '.join(arguments)} ended with {done.returncode}")
    wall_s, used = time.perf_counter() - start_s, resource.getrusage(resource.RUSAGE_CHILDREN)
    return Cost(wall_s, used.ru_utime + used.ru_stime - before.ru_utime - before.ru_stime)


@contextmanager
def child(
    command: Sequence[str | Path], within_s: float = LIMIT_S, **options: Any
) -> Iterator[subprocess.Popen[Any]]:
    """Start a process, and end it and its pipes with the block, at the latest after ``within_s``.

    So code that reads its pipes or waits for it cannot block for longer. It is ended by SIGTERM, or
    by SIGKILL if it ignores that.
    """
    process = subprocess.Popen(command, **options)
    late = threading.Timer(within_s, process.kill)
    late.start()
    try:
        yield process
    finally:
        late.cancel()
        process.terminate()  # SIGINT does not suffice: a shell starts background jobs without it
        with suppress(subprocess.TimeoutExpired):
            process.wait(LEAVE_S)
        process.kill()
        process.wait(LEAVE_S)
        for stream in filter(None, (process.stdin, process.stdout, process.stderr)):
            with suppress(OSError):  # closing flushes what the process never read
                stream.close()


@contextmanager
def flights_page(
    folder: Path, within_s: float = LIMIT_S
) -> Iterator[tuple[str, subprocess.Popen[str]]]:
    """Serve a folder by ``yawid serve``; yield the address of the page, and the process."""
    command = [sys.executable, "-m", "yawid", "serve", str(folder), "--port=0", "--no-browser"]
    pipe = subprocess.PIPE
    with child(command, within_s, stdout=pipe, stderr=pipe, text=True) as process:
        yield next(iter(process.stdout or ()), "").partition(" ")[0], process


def free_udp_port() -> int:
    """Return a free UDP port of this machine."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])
