"""What a worker does, on this machine or in Dask: a process of its own replays its logs.

This file imports nothing large, so that a worker needs much less memory than its process.
"""

import logging
import subprocess
import sys
import threading
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any

from yawid.dataset.values import failed
from yawid.system.child import DiedError, LateError, Worker
from yawid.version import __version__

MOST_DEATHS = 3
"""After so many deaths of its process a log is blamed; fewer may have another cause."""
REPLAYS = "yawid.fleet.one_log"
"""The module that a process imports before its first log."""


@dataclass(frozen=True, slots=True)
class Task:
    """A log to be replayed: its path or URL.

    ``spec`` is a :class:`yawid.fleet.spec.Spec`, whose import would be large.
    """

    path: str
    spec: Any
    timeout_s: float

    def rows(self, copies: Path) -> Any:
        """Return the log's rows by table, or None if this machine has no such file."""
        from yawid.fleet.one_log import rows_here

        return rows_here(self.path, self.spec, copies)


def replayed(task: Task, worker: Worker, copies: Path) -> Any:
    """Return a log's rows by table, replayed by the process of ``worker``; None: no such file.

    A log of a store is copied below the folder ``copies``, where a killed process leaves it. A log
    that kills its process or takes longer than ``task.timeout_s`` gets the rows of a failure.

    Raises:
        OSError: the process cannot be started.
    """
    how = "was ended"
    for _ in range(0 if worker.is_over else MOST_DEATHS):
        try:
            return worker.call(partial(task.rows, copies), task.timeout_s)
        except LateError:
            text = f"it did not finish within {task.timeout_s:g} s: allow more with --timeout"
            return failed("timeout", text)
        except DiedError as error:
            how = str(error)
    return failed("crashed", f"its process {how}, {MOST_DEATHS} times")


def replayed_in_dask(task: Task) -> Any:
    """Return :func:`replayed` by the process of this thread, which ends with it.

    Dask removes what a worker has left in its folder.
    """
    from distributed import get_worker

    worker: Worker | None = getattr(_own, "worker", None)
    if worker is None:
        worker = _own.worker = Worker(REPLAYS)
    return replayed(task, worker, Path(get_worker().local_directory))


_own = threading.local()


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
