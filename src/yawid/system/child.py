"""A child process that takes one order after the other; orders and answers are pickled in pipes.

An order that crashes its process, or takes all memory, does so to the child: the parent survives.
``python -m yawid.system.child MODULE`` is a child that imports a module and makes calls.
"""

import os
import pickle
import queue
import signal
import subprocess
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from importlib import import_module
from operator import call
from typing import Any, Final

from yawid.system.processes import OWN_GROUP, die_with_parent

DIED: Final = object()
"""The answer of a child that has ended."""
DYING_S = 1.0
"""Time limit in s for a child's end once its stdin is closed."""
ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
"""Environment of a child: one thread for linear algebra, as each core already has a child."""
TRIMMED = "MALLOC_TRIM_THRESHOLD_"
"""A variable that Dask sets for its workers and a child does not get: with it memory goes back to
the system each time, which takes 20 % longer."""
_READY = "ready"


class Child:
    """A process that runs ``python -m`` with the words given: a module that calls :func:`serve`.

    Raises:
        OSError: the process cannot be started.
    """

    def __init__(self, *words: str) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-m", *words],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            creationflags=OWN_GROUP,
            env={k: v for k, v in os.environ.items() if k != TRIMMED} | ONE_THREAD,
        )

    def is_ready(self) -> bool:
        """Wait until the child can take orders; return False if it ended instead."""
        return bool(self._received() == _READY)

    def answer(self, order: object) -> Any:
        """Return the child's answer to an order, or ``DIED`` if it ended instead."""
        assert self._process.stdin is not None
        try:
            pickle.dump(order, self._process.stdin)
            self._process.stdin.flush()
        except OSError:
            return DIED
        return self._received()

    def _received(self) -> Any:
        assert self._process.stdout is not None
        try:
            return pickle.load(self._process.stdout)
        except (OSError, EOFError, pickle.UnpicklingError):
            return DIED

    def kill(self) -> None:
        """Kill the process, also from another thread."""
        self._process.kill()

    def close(self) -> str:
        """End the process; return how it ended, in words."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        with suppress(OSError):  # closing flushes what the process never read
            self._process.stdin.close()
        with suppress(subprocess.TimeoutExpired):  # a healthy process ends by itself
            self._process.wait(DYING_S)
        self._process.kill()
        self._process.stdout.close()
        return _how(self._process.wait())


def serve(answer: Callable[[Any], Any]) -> None:
    """Answer the parent's orders until stdin ends; what other code prints goes to stderr.

    To be called once all imports are done. If ``answer`` raises, the process ends with code 1.
    """
    orders, answers = sys.stdin.buffer, os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    for number in (signal.SIGINT, signal.SIGTERM):  # the parent handles them and closes the pipe
        signal.signal(number, signal.SIG_IGN)
    die_with_parent()
    waiting: queue.SimpleQueue[Any] = queue.SimpleQueue()
    threading.Thread(target=_take, args=(orders, waiting), daemon=True).start()
    answered: object = _READY
    try:
        while True:
            pickle.dump(answered, answers)
            answers.flush()
            answered = answer(waiting.get())
    finally:
        os._exit(1)  # at once: the other thread would hold up an orderly end


def _take(orders: Any, waiting: "queue.SimpleQueue[Any]") -> None:
    """Take orders until stdin ends; then the parent has ended, and this process ends at once."""
    try:
        while True:
            waiting.put(pickle.load(orders))
    finally:
        os._exit(0)


def _how(code: int) -> str:
    if code >= 0:
        return f"ended with exit code {code}"
    try:
        return f"was killed by {signal.Signals(-code).name}"
    except ValueError:
        return f"was killed by signal {-code}"


if __name__ == "__main__":
    import_module(sys.argv[1])  # before the first call, as that takes time
    serve(call)
