"""The thread on which a live session has its manoeuvres answered."""

import queue
import threading
from collections.abc import Callable
from concurrent.futures import Executor, Future
from functools import partial
from typing import ParamSpec, TypeVar

_P = ParamSpec("_P")
_T = TypeVar("_T")


class Worker(Executor):
    """One thread that does what it is given, one after the other; what it raises is its future's.

    A second signal ends the process at once: unlike ``ThreadPoolExecutor``'s the thread is a
    daemon, for which Python does not wait when it exits.
    """

    def __init__(self) -> None:
        self._calls: queue.SimpleQueue[Callable[[], None] | None] = queue.SimpleQueue()
        threading.Thread(target=self._run, name="yawid-manoeuvres", daemon=True).start()

    def submit(self, fn: Callable[_P, _T], /, *args: _P.args, **kwargs: _P.kwargs) -> "Future[_T]":
        """See :class:`concurrent.futures.Executor`."""
        future: Future[_T] = Future()
        self._calls.put(partial(_do, future, partial(fn, *args, **kwargs)))
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the thread when it is done with what it was given; nobody waits for that."""
        self._calls.put(None)

    def _run(self) -> None:
        while (call := self._calls.get()) is not None:
            call()


def _do(future: "Future[_T]", act: Callable[[], _T]) -> None:
    try:
        future.set_result(act())
    except BaseException as error:
        future.set_exception(error)
