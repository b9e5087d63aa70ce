"""Threads for slow work of all sessions: one for fits, one for the disk, one for viewers."""

import os
import queue
import threading
from collections.abc import Callable
from concurrent.futures import Executor, Future
from functools import partial
from typing import BinaryIO, ParamSpec, TypeVar

from yawid.system.part_file import Disk, sync

_P = ParamSpec("_P")
_T = TypeVar("_T")


class Worker(Executor):
    """One thread that makes the calls it is given one after the other; futures hold their errors.

    The thread is a daemon, unlike those of ``ThreadPoolExecutor``: Python does not wait for it at
    exit, so that a second signal ends the process at once.
    """

    def __init__(self, name: str) -> None:
        self._calls: queue.SimpleQueue[Callable[[], None] | None] = queue.SimpleQueue()
        threading.Thread(target=self._run, name=name, daemon=True).start()

    @property
    def waiting(self) -> int:
        """The number of calls that wait for the present one to end."""
        return self._calls.qsize()

    def submit(self, fn: Callable[_P, _T], /, *args: _P.args, **kwargs: _P.kwargs) -> "Future[_T]":
        """See :class:`concurrent.futures.Executor`."""
        future: Future[_T] = Future()
        self._calls.put(partial(_do, future, partial(fn, *args, **kwargs)))
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the thread after the calls it was given; this returns at once."""
        self._calls.put(None)

    def _run(self) -> None:
        while (call := self._calls.get()) is not None:
            call()


def _do(future: "Future[_T]", act: Callable[[], _T]) -> None:
    try:
        future.set_result(act())
    except BaseException as error:
        future.set_exception(error)


class SharedDisk(Disk):
    """A disk whose files a thread synchronises, which takes milliseconds: the loop does not wait.

    Each file waits once at most; what is written after that is for the next call. Others may use
    ``worker`` for writing too.
    """

    def __init__(self, worker: Executor) -> None:
        self.worker = worker
        self._syncing: dict[BinaryIO, Future[None]] = {}

    def sync_soon(self, stream: BinaryIO) -> None:
        """See :meth:`yawid.system.part_file.Disk.sync_soon`."""
        stream.flush()
        before = self._syncing.get(stream)
        if before is not None and not before.done():
            return
        if before is not None:
            del self._syncing[stream]
            before.result()
        # The thread needs its own descriptor: the stream may be closed before its turn comes.
        self._syncing[stream] = self.worker.submit(_sync_and_close, os.dup(stream.fileno()))

    def sync_now(self, stream: BinaryIO) -> None:
        """See :meth:`yawid.system.part_file.Disk.sync_now`; it is the last call for a stream."""
        before = self._syncing.pop(stream, None)
        if before is not None:
            before.result()
        sync(stream)


def _sync_and_close(descriptor: int) -> None:
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
