"""What a worker does, on this machine or in Dask: a process of its own replays its logs.

This file imports nothing large, so that a worker needs much less memory than its process.
"""

import logging
import subprocess
import sys
import threading
from contextlib import suppress
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any, Final

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
        """Return the log's rows by table."""
        from yawid.fleet.one_log import rows_here

        return rows_here(self.path, self.spec, copies)


OWN: Final = threading.local()
"""``OWN.worker`` is the process of each thread that replays logs."""


def replayed(task: Task, copies: Path) -> Any:
    """Return a log's rows by table, replayed by this thread's process.

    A log of a store is copied below the folder ``copies``, where a killed process leaves it. A log
    that kills its process or takes longer than ``task.timeout_s`` gets the rows of a failure.

    Raises:
        OSError: the process cannot be started.
    """
    worker: Worker = OWN.__dict__.setdefault("worker", Worker(REPLAYS))
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
    """Return :func:`replayed`; what that leaves in the folder of Dask's worker, Dask removes."""
    from distributed import get_worker

    return replayed(task, Path(get_worker().local_directory))


def ready() -> str:
    """Compile on this machine, where it has not been; return the version of yawid on it."""
    warm()
    return __version__


@cache
def warm() -> None:
    """Compile the estimators of this machine in a separate process, so that workers stay small.

    If that fails, each process compiles for itself or runs slowly; a logged line gives the reason.
    """
    compiles = "from yawid.estimation.machine.runner import compile_behind; compile_behind()"
    with suppress(OSError):  # whoever starts the process that replays reports that
        done = subprocess.run(
            [sys.executable, "-c", compiles], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
            text=True, errors="replace", check=False,
        )  # fmt: skip
        if done.returncode and (said := done.stderr.strip()):
            logging.getLogger(__name__).warning("%s", said.splitlines()[-1])
