"""What a worker does, on this machine or in Dask: it starts and watches a child that replays logs.

This file imports nothing large, so that a worker needs much less memory than its child.
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
from yawid.system.processes import OWN_GROUP
from yawid.version import __version__

MOST_DEATHS = 3
"""After so many deaths of its process a log is blamed; fewer may have another cause."""
QUEUED, POLL_S = 2, 0.1
"""How many logs a worker holds (it replays one, one waits); the longest wait for a result in s."""
CRASHED, TIMEOUT = "crashed", "timeout"
START_S, DYING_S = 300.0, 1.0
"""Time limits in s: for the start of a child, and for its end once its stdin is closed."""
ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
"""Environment of a child: one thread for linear algebra, as each core already has a worker."""
TRIMMED = "MALLOC_TRIM_THRESHOLD_"
"""A variable that Dask sets for its workers and a child does not get: with it memory goes back to
the system each time, which takes 20 % longer."""


@dataclass(frozen=True, slots=True)
class Task:
    """A log to be replayed: its path or URL, and its bytes if no other process can read them.

    ``spec`` is a :class:`yawid.fleet.spec.Spec`, whose import would be large.
    """

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
        """Return a log's rows by table, or None if this machine has no such file.

        A log that kills its process or takes longer than ``task.timeout_s`` gets the rows of a
        failure.

        Raises:
            RuntimeError: the process cannot be started.
        """
        code = 0
        for _ in range(0 if self._is_over else MOST_DEATHS):
            process = self._process or self._start()
            is_late = threading.Event()
            with (
                tempfile.TemporaryDirectory(prefix="yawid-fleet-") as scratch,
                _killed_after(task.timeout_s, process, is_late),
            ):
                answer = _answer_of(process, (task.path, task.spec, scratch, task.data))
            if answer is not _DIED:
                return answer
            code = self.close()
            if self._is_over:
                break
            if is_late.is_set():
                text = f"it did not finish within {task.timeout_s:g} s: allow more with --timeout"
                return failed(TIMEOUT, text)
        return failed(CRASHED, f"its process {_how(code)}, {MOST_DEATHS} times")

    def _start(self) -> "subprocess.Popen[bytes]":
        self._process = process = subprocess.Popen(
            [sys.executable, "-m", "yawid.fleet.child"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            creationflags=OWN_GROUP,
            env={k: v for k, v in os.environ.items() if k != TRIMMED} | ONE_THREAD,
        )
        if self._is_over:  # another thread called end() before there was a process to kill
            process.kill()
        with _killed_after(START_S, process, threading.Event()):
            answer = _answer_of(process)
        if answer is _DIED:
            raise RuntimeError(f"python -m yawid.fleet.child {_how(self.close())}")
        return process

    def end(self) -> None:
        """Kill the process from another thread. Its log gets no answer, and no other is begun."""
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
        with suppress(OSError):  # closing flushes what the process never read
            process.stdin.close()
        with suppress(subprocess.TimeoutExpired):  # a healthy process ends by itself
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


def _answer_of(process: "subprocess.Popen[bytes]", order: object = None) -> Any:
    """Return what the process answers to an order, or ``_DIED`` if it ended instead."""
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
    """Return a log's rows by table, replayed by the child process of this thread."""
    child: Child | None = getattr(_own, "child", None)
    if child is None:
        child = _own.child = Child()
        atexit.register(child.close)
    return child.rows(task)


def about() -> Mapping[str, str]:
    """Return the versions of yawid and Python on this machine."""
    return {"yawid": __version__, "python": sys.version.split()[0]}


@cache
def warm() -> None:
    """Compile the estimators of this machine in a separate process, so that workers stay small.

    If that fails, each child compiles for itself or runs slowly; a logged line gives the reason.
    """
    command = [sys.executable, "-m", "yawid", "warm"]
    done = subprocess.run(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, errors="replace",
        check=False,
    )  # fmt: skip
    if done.returncode == YawidError.exit_code and (said := done.stderr.strip()):
        logging.getLogger(__name__).warning("%s", said.splitlines()[-1])


def _how(code: int) -> str:
    if code >= 0:
        return f"ended with exit code {code}"
    try:
        return f"was killed by {signal.Signals(-code).name}"
    except ValueError:
        return f"was killed by signal {-code}"
