"""What runs in a Dask worker: it has a child process replay a log and watches it.

Nothing heavy is imported here: a worker is small beside its child.
"""

import atexit
import pickle
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from yawid import __version__
from yawid.fleet.values import failed

MOST_DEATHS = 3
"""A log whose process was killed so often is to blame; fewer may be another's doing."""
CRASHED, TIMEOUT = "crashed", "timeout"


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

    def rows(self, task: Task) -> Any:
        """Return a log's rows by table; None: there is no such file on this machine."""
        deaths = 0
        while True:
            with tempfile.TemporaryDirectory(prefix="yawid-fleet-") as scratch:
                answer = self._ask(task, scratch)
            if answer is not _DIED:
                return answer
            code = self._end()
            deaths += 1
            if code is None:
                text = f"no answer within {task.timeout_s:g} s: --timeout allows more"
                return failed(TIMEOUT, text)
            if deaths == MOST_DEATHS:
                return failed(CRASHED, f"its process {_how(code)}, {deaths} times")

    def close(self) -> None:
        """End the process."""
        self._end(wait_s=0.0)

    def _ask(self, task: Task, scratch: str) -> Any:
        process = self._process or self._start()
        assert process.stdin is not None
        assert process.stdout is not None
        is_late = threading.Event()

        def late() -> None:
            is_late.set()
            process.kill()

        timer = threading.Timer(task.timeout_s, late)
        timer.start()
        try:
            pickle.dump((task.path, task.spec, scratch, task.data), process.stdin)
            process.stdin.flush()
            return pickle.load(process.stdout)
        except (OSError, EOFError, pickle.UnpicklingError):
            self._was_late = is_late.is_set()
            return _DIED
        finally:
            timer.cancel()

    def _start(self) -> "subprocess.Popen[bytes]":
        self._process = subprocess.Popen(
            [sys.executable, "-m", "yawid.fleet.child"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
        )
        return self._process

    def _end(self, wait_s: float = 5.0) -> int | None:
        """Let go of the process; return its exit code, None where it was killed for being late."""
        process, self._process = self._process, None
        if process is None:
            return 0
        assert process.stdin is not None
        assert process.stdout is not None
        try:
            code = process.wait(wait_s)
        except subprocess.TimeoutExpired:
            process.kill()
            code = process.wait()
        for pipe in (process.stdin, process.stdout):
            with suppress(OSError):  # what it never read
                pipe.close()
        return None if self._was_late else code

    _was_late = False


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


def warm() -> None:
    """Make the compiled code of this machine, in a process of its own: workers stay small."""
    subprocess.run(
        [sys.executable, "-m", "yawid", "warm"],
        check=True,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
    )


def _how(code: int) -> str:
    if code >= 0:
        return f"ended with exit code {code}"
    try:
        return f"was killed by {signal.Signals(-code).name}"
    except ValueError:
        return f"was killed by signal {-code}"
