"""What a worker does, on this machine or in Dask: a process of its own replays its logs.

This file imports nothing large, so that a worker needs much less memory than its process.
"""

import atexit
import logging
import shutil
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any

from yawid.dataset.values import failed
from yawid.system.child import DiedError, LateError, Worker
from yawid.system.files import lock
from yawid.system.part_file import os_errors_as_sink_error
from yawid.version import __version__

MOST_DEATHS = 3
"""After so many deaths of its process a log is blamed; fewer may have another cause."""
REPLAYS = "yawid.fleet.one_log"
"""The module that a process imports before its first log."""
SCRATCH, LOCK = "yawid-fleet-", ".lock"
"""How the names of folders for copies begin, and the file in them that is locked."""


@dataclass(frozen=True, slots=True)
class Task:
    """A log to be replayed: its path or URL.

    ``spec`` is a :class:`yawid.fleet.spec.Spec`, whose import would be large.
    """

    path: str
    spec: Any
    timeout_s: float

    def rows(self, scratch: str) -> Any:
        """Return the log's rows by table, or None if this machine has no such file."""
        from yawid.fleet.one_log import rows_here

        return rows_here(self.path, self.spec, Path(scratch))


def replayed(task: Task, worker: Worker) -> Any:
    """Return a log's rows by table, replayed by the process of ``worker``; None: no such file.

    A log that kills its process or takes longer than ``task.timeout_s`` gets the rows of a failure.

    Raises:
        OSError: the process cannot be started.
    """
    how = "was ended"
    for _ in range(0 if worker.is_over else MOST_DEATHS):
        with tempfile.TemporaryDirectory(dir=_scratch_here()) as scratch:
            try:
                return worker.call(partial(task.rows, scratch), task.timeout_s)
            except LateError:
                text = f"it did not finish within {task.timeout_s:g} s: allow more with --timeout"
                return failed("timeout", text)
            except DiedError as error:
                how = str(error)
    return failed("crashed", f"its process {how}, {MOST_DEATHS} times")


def replayed_in_dask(task: Task) -> Any:
    """Return :func:`replayed` by the process of this thread, which ends with it."""
    worker: Worker | None = getattr(_own, "worker", None)
    if worker is None:
        worker = _own.worker = Worker(REPLAYS)
    return replayed(task, worker)


_own = threading.local()


@cache
def _scratch_here() -> Path:
    """Return the folder for copies of this process, which is removed when the process ends."""
    opened = ExitStack()
    atexit.register(opened.close)
    return opened.enter_context(_scratch_folder())


@contextmanager
def _scratch_folder() -> Iterator[Path]:
    """Yield a new folder for copies of logs; those that a killed process has left are removed.

    A folder is in use while its file ``LOCK`` is locked, which it is from its first moment on.

    Raises:
        SinkError: the folder cannot be made.
    """
    temporary = Path(tempfile.gettempdir())
    for left in temporary.glob(f"{SCRATCH}*"):
        with suppress(OSError):  # it is in use, or of another user
            with (left / LOCK).open("r+b") as held:
                lock(held.fileno())
            shutil.rmtree(left, ignore_errors=True)
    with os_errors_as_sink_error(temporary):
        folder = Path(tempfile.mkdtemp(prefix=SCRATCH))
        file = (folder / "made").open("wb")
        with suppress(OSError):  # a disk without locks
            lock(file.fileno())
        (folder / "made").rename(folder / LOCK)
    try:
        yield folder
    finally:
        file.close()
        shutil.rmtree(folder, ignore_errors=True)


def version() -> str:
    """Return the version of yawid on this machine."""
    return __version__


@cache
def warm() -> None:
    """Compile the estimators of this machine in a separate process, so that workers stay small.

    If that fails, each process compiles for itself or runs slowly; a logged line gives the reason.
    """
    compiles = "from yawid.estimation.machine.runner import compile_behind; compile_behind()"
    command = [sys.executable, "-c", compiles]
    try:
        done = subprocess.run(
            command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, errors="replace",
            check=False,
        )  # fmt: skip
    except OSError:  # whoever starts the process that replays reports that
        return
    if done.returncode and (said := done.stderr.strip()):
        logging.getLogger(__name__).warning("%s", said.splitlines()[-1])
