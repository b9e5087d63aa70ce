"""What a worker does, here or in Dask: it has a child process replay a log and watches it.

Nothing heavy is imported here: a worker is small beside its child.
"""

import atexit
import logging
import os
import pickle
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cache
from typing import Any

from yawid.dataset.values import failed
from yawid.errors import YawidError
from yawid.version import __version__

MOST_DEATHS = 3
"""A log whose process was killed so often is to blame; fewer may be another's doing."""
QUEUED, POLL_S = 2, 0.1
"""Logs that a worker holds: one it replays, and one that waits; how often a result is asked for."""
CRASHED, TIMEOUT = "crashed", "timeout"
START_S, DYING_S = 300.0, 1.0
ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
"""Each core has a worker already."""
TRIMMED = "MALLOC_TRIM_THRESHOLD_"
"""Dask sets it for its workers; a child that gives all memory back each time needs 20 % longer."""


@dataclass(frozen=True, slots=True)
class Task:
    """A log to be replayed: its path or URL, and its bytes where no other process sees them."""

    path: str
    spec: Any
    timeout_s: float
    data: bytes | None = None


class Child:
    """A process that replays one log after the other."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self._is_over = False

    def rows(self, task: Task) -> Any:
        """Return a log's rows by table; None: there is no such file on this machine.

        Raises:
            RuntimeError: the process does not even start.
        """
        code = 0
        for _ in range(0 if self._is_over else MOST_DEATHS):
            process = self._process or self._start()
            is_late = threading.Event()
            with (
                tempfile.TemporaryDirectory(prefix="yawid-fleet-") as scratch,
                _killed_after(task.timeout_s, process, is_late),
            ):
                answer = _told(process, (task.path, task.spec, scratch, task.data))
            if answer is not _DIED:
                return answer
            code = self.close()
            if self._is_over:
                break
            if is_late.is_set():
                text = f"no answer within {task.timeout_s:g} s: --timeout allows more"
                return failed(TIMEOUT, text)
        return failed(CRASHED, f"its process {_how(code)}, {MOST_DEATHS} times")

    def _start(self) -> "subprocess.Popen[bytes]":
        self._process = process = subprocess.Popen(
            [sys.executable, "-m", "yawid.fleet.child"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env={k: v for k, v in os.environ.items() if k != TRIMMED} | ONE_THREAD,
        )
        if self._is_over:  # told so by another thread, before there was one to be killed
            process.kill()
        with _killed_after(START_S, process, threading.Event()):
            answer = _told(process)
        if answer is _DIED:
            raise RuntimeError(f"python -m yawid.fleet.child {_how(self.close())}")
        return process

    def end(self) -> None:
        """Kill the process from another thread; its log is not answered, and no other is begun."""
        self._is_over = True
        if (process := self._process) is not None:
            process.kill()

    def close(self) -> int:
        """End the process; return its exit code."""
        process, self._process = self._process, None
        if process is None:
            return 0
        assert process.stdin is not None
        assert process.stdout is not None
        with suppress(OSError):  # what it never read
            process.stdin.close()
        with suppress(subprocess.TimeoutExpired):  # it ends by itself where it can
            process.wait(DYING_S)
        process.kill()
        process.stdout.close()
        return process.wait()


@contextmanager
def _killed_after(
    seconds: float, process: "subprocess.Popen[bytes]", is_late: threading.Event
) -> Iterator[None]:
    def late() -> None:
        is_late.set()
        process.kill()

    timer = threading.Timer(seconds, late)
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


def _told(process: "subprocess.Popen[bytes]", order: object = None) -> Any:
    """Return what the process answers to an order; ``_DIED`` where it ended instead."""
    assert process.stdin is not None
    assert process.stdout is not None
    try:
        if order is not None:
            pickle.dump(order, process.stdin)
            process.stdin.flush()
        return pickle.load(process.stdout)
    except (OSError, EOFError, pickle.UnpicklingError):
        return _DIED


_DIED = object()
_own = threading.local()


def work(task: Task) -> Any:
    """Return a log's rows by table, by the child process of this thread."""
    child: Child | None = getattr(_own, "child", None)
    if child is None:
        child = _own.child = Child()
        atexit.register(child.close)
    return child.rows(task)


def about() -> Mapping[str, str]:
    """Return what must be alike on all machines."""
    return {"yawid": __version__, "python": sys.version.split()[0]}


@cache
def warm() -> None:
    """Make the compiled code of this machine, in a process of its own: workers stay small.

    Where that cannot be, each child compiles for itself, or is slow; its one line says why.
    """
    command = [sys.executable, "-m", "yawid", "warm"]
    pipe = subprocess.PIPE
    done = subprocess.run(command, stdout=subprocess.DEVNULL, stderr=pipe, text=True, check=False)
    if done.returncode == YawidError.exit_code and (said := done.stderr.strip()):
        logging.getLogger(__name__).warning("%s", said.splitlines()[-1])


def _how(code: int) -> str:
    if code >= 0:
        return f"ended with exit code {code}"
    try:
        return f"was killed by {signal.Signals(-code).name}"
    except ValueError:
        return f"was killed by signal {-code}"
