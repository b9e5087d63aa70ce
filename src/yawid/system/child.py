"""A process that makes calls one after the other; calls and results are pickled in pipes.

A call that crashes its process, hangs or stops it, or takes all memory, does so to that process:
this one survives, knows which call it was, and starts another.
``python -m yawid.system.child MODULE`` is such a process; it imports a module first.
"""

import gc
import os
import pickle
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from importlib import import_module
from typing import Any, Final, TypeVar

from yawid.system.processes import OWN_GROUP, die_with_parent

_T = TypeVar("_T")
START_S: Final = 300.0
"""Time limit in s for a process to start and import its module."""
DYING_S = 1.0
"""Time limit in s for a process's end once its stdin is closed."""
ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
"""Environment of a process: one thread for linear algebra, as each core already has a process."""
TRIMMED = "MALLOC_TRIM_THRESHOLD_"
"""A variable that Dask sets for its workers and a process does not get: with it memory goes back to
the system each time, which takes 20 % longer."""
GARBAGE_AFTER = 50_000
"""The first threshold of the garbage collector, in objects: a high one saves time."""


class DiedError(Exception):
    """The process of a call ended without a result; the text says how."""


class LateError(DiedError):
    """The process was killed, as it gave no result in time."""


class Worker:
    """Makes calls in a process that has imported ``module``, and in another one if that dies."""

    def __init__(self, module: str) -> None:
        self._module = module
        self._process: subprocess.Popen[bytes] | None = None
        self.is_over = False

    def start(self) -> None:
        """Start the process if there is none, and wait until it can make calls.

        Raises:
            OSError: it cannot be started, or ends by itself.
            DiedError: it was killed.
        """
        if self._process is None:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "yawid.system.child", self._module],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                creationflags=OWN_GROUP,
                env={k: v for k, v in os.environ.items() if k != TRIMMED} | ONE_THREAD,
            )
            begun = self._process
            try:
                self._result(int, START_S)
            except DiedError as error:
                if begun.returncode < 0:
                    raise
                raise OSError(f"python -m yawid.system.child {self._module} {error}") from error

    def call(self, act: Callable[[], _T], limit_s: float) -> _T:
        """Return what ``act`` returns in the process, which is started if there is none.

        Raises:
            LateError: there was no result within ``limit_s`` seconds, and the process was killed.
            DiedError: the process ended, also by :meth:`end` or as ``act`` raised an error.
            OSError: the process cannot be started.
        """
        self.start()
        result: _T = self._result(act, limit_s)
        return result

    def _result(self, act: Callable[[], Any], limit_s: float) -> Any:
        process = self._process
        assert process is not None
        assert process.stdin is not None
        assert process.stdout is not None
        timer = threading.Timer(limit_s, process.kill)
        timer.daemon = True
        end_s = time.monotonic() + limit_s
        timer.start()
        if self.is_over:  # another thread called end() before there was a process to kill
            process.kill()
        try:
            pickle.dump(act, process.stdin)
            process.stdin.flush()
            return pickle.load(process.stdout)
        except (OSError, EOFError, pickle.UnpicklingError) as error:
            died = LateError if time.monotonic() >= end_s else DiedError
            raise died(self.close()) from error
        finally:
            timer.cancel()

    def end(self) -> None:
        """Kill the process from another thread. Its call has no result, and no other has one."""
        self.is_over = True
        if (process := self._process) is not None:
            process.kill()

    def close(self) -> str:
        """End the process; return how it ended, in words."""
        process, self._process = self._process, None
        if process is None:
            return ""
        assert process.stdin is not None
        assert process.stdout is not None
        with suppress(OSError):  # closing flushes what the process never read
            process.stdin.close()
        with suppress(subprocess.TimeoutExpired):  # a healthy process ends by itself
            process.wait(DYING_S)
        process.kill()
        process.stdout.close()
        return _how(process.wait())


def _how(code: int) -> str:
    if code >= 0:
        return f"ended with exit code {code}"
    names = {each.value: each.name for each in signal.Signals}
    return f"was killed by {names.get(-code, f'signal {-code}')}"


def _serve() -> None:
    """Make the parent's calls until stdin ends; what other code prints goes to stderr.

    If a call raises an error, the process ends with code 1.
    """
    calls, results = sys.stdin.buffer, os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    for number in (signal.SIGINT, signal.SIGTERM):  # the parent handles them and closes the pipe
        signal.signal(number, signal.SIG_IGN)
    gc.freeze()  # imported modules never become garbage
    gc.set_threshold(GARBAGE_AFTER)
    with suppress(EOFError):  # the parent has closed its end
        while True:
            pickle.dump(pickle.load(calls)(), results)
            results.flush()


if __name__ == "__main__":
    die_with_parent()  # first, as it may be stopped while it imports
    import_module(sys.argv[1])  # before the first call, as that takes time
    _serve()
