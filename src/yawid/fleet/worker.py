"""What a worker does, on this machine or in Dask: it starts and watches a child that replays logs.

This file imports nothing large, so that a worker needs much less memory than its child.
"""

import atexit
import logging
import shutil
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, BinaryIO

from yawid.dataset.values import failed
from yawid.system.child import DIED, Child
from yawid.system.files import lock
from yawid.system.part_file import os_errors_as_sink_error
from yawid.version import __version__

MOST_DEATHS = 3
"""After so many deaths of its process a log is blamed; fewer may have another cause."""
QUEUED, POLL_S = 2, 0.1
"""How many logs a worker holds (it replays one, one waits); the longest wait for a result in s."""
CRASHED, TIMEOUT = "crashed", "timeout"
SCRATCH, LOCK = "yawid-fleet-", ".lock"
"""How the names of folders for copies begin, and the file in them that is locked."""
START_S = 300.0
"""Time limit in s for the start of a child."""


@dataclass(frozen=True, slots=True)
class Task:
    """A log to be replayed: its path or URL.

    ``spec`` is a :class:`yawid.fleet.spec.Spec`, whose import would be large.
    """

    path: str
    spec: Any
    timeout_s: float


class Replayer:
    """A child process that replays one log after the other, and the next one if it dies."""

    def __init__(self, scratch: Path) -> None:
        self._scratch = scratch
        self._child: Child | None = None
        self._is_over = False

    def rows(self, task: Task) -> Any:
        """Return a log's rows by table, or None if this machine has no such file.

        A log that kills its process or takes longer than ``task.timeout_s`` gets the rows of a
        failure.

        Raises:
            RuntimeError: the process cannot be started.
        """
        how = ""
        for _ in range(0 if self._is_over else MOST_DEATHS):
            child = self._child or self._start()
            is_late = threading.Event()
            with (
                tempfile.TemporaryDirectory(dir=self._scratch) as scratch,
                _killed_after(task.timeout_s, child, is_late),
            ):
                answer = child.answer((task.path, task.spec, Path(scratch)))
            if answer is not DIED:
                return answer
            how = self.close()
            if self._is_over:
                break
            if is_late.is_set():
                text = f"it did not finish within {task.timeout_s:g} s: allow more with --timeout"
                return failed(TIMEOUT, text)
        return failed(CRASHED, f"its process {how}, {MOST_DEATHS} times")

    def _start(self) -> Child:
        self._child = child = Child("yawid.fleet.child")
        if self._is_over:  # another thread called end() before there was a process to kill
            child.kill()
        with _killed_after(START_S, child, threading.Event()):
            is_ready = child.is_ready()
        if not is_ready:
            raise RuntimeError(f"python -m yawid.fleet.child {self.close()}")
        return child

    def end(self) -> None:
        """Kill the process from another thread. Its log gets no answer, and no other is begun."""
        self._is_over = True
        if (child := self._child) is not None:
            child.kill()

    def close(self) -> str:
        """End the process; return how it ended, in words."""
        child, self._child = self._child, None
        return "" if child is None else child.close()


@contextmanager
def _killed_after(seconds: float, child: Child, is_late: threading.Event) -> Iterator[None]:
    def late() -> None:
        is_late.set()
        child.kill()

    timer = threading.Timer(seconds, late)
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


_own = threading.local()


def work(task: Task) -> Any:
    """Return a log's rows by table, replayed by the child process of this thread."""
    replayer: Replayer | None = getattr(_own, "replayer", None)
    if replayer is None:
        replayer = _own.replayer = Replayer(_scratch_here())
        atexit.register(replayer.close)
    return replayer.rows(task)


@cache
def _scratch_here() -> Path:
    """Return the folder for copies of this process, which is removed when the process ends."""
    opened = ExitStack()
    atexit.register(opened.close)
    return opened.enter_context(scratch_folder())


@contextmanager
def scratch_folder() -> Iterator[Path]:
    """Yield a new folder for copies of logs; those that a killed process has left are removed.

    A folder is in use while its file ``LOCK`` is locked.

    Raises:
        SinkError: the folder cannot be made.
    """
    for left in Path(tempfile.gettempdir()).glob(f"{SCRATCH}*"):
        with suppress(OSError):  # it is in use, or of another user
            with (left / LOCK).open("r+b") as held:
                lock(held.fileno())
            shutil.rmtree(left, ignore_errors=True)
    folder, file = _locked_folder()
    try:
        yield folder
    finally:
        file.close()
        shutil.rmtree(folder, ignore_errors=True)


def _locked_folder() -> tuple[Path, BinaryIO]:
    while True:
        with os_errors_as_sink_error(Path(tempfile.gettempdir())):
            folder = Path(tempfile.mkdtemp(prefix=SCRATCH))
            file = (folder / LOCK).open("wb")
        with suppress(OSError):  # another fleet is removing it
            lock(file.fileno())
        if (folder / LOCK).exists():
            return folder, file
        file.close()


def about() -> Mapping[str, str]:
    """Return the versions of yawid and Python on this machine."""
    return {"yawid": __version__, "python": sys.version.split()[0]}


@cache
def warm() -> None:
    """Compile the estimators of this machine in a separate process, so that workers stay small.

    If that fails, each child compiles for itself or runs slowly; a logged line gives the reason.
    """
    compiles = "from yawid.estimation.machine.runner import compile_behind; compile_behind()"
    command = [sys.executable, "-c", compiles]
    try:
        done = subprocess.run(
            command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, errors="replace",
            check=False,
        )  # fmt: skip
    except OSError:  # whoever starts the child that replays reports that
        return
    if done.returncode and (said := done.stderr.strip()):
        logging.getLogger(__name__).warning("%s", said.splitlines()[-1])
