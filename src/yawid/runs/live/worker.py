"""Threads for slow work of all sessions: one for the disk, one for viewers, one for fits.

The fits of many vehicles are made by processes, each with a thread here.
"""

import os
import queue
import threading
from collections.abc import Callable
from concurrent.futures import CancelledError, Executor, Future
from contextlib import suppress
from functools import partial
from typing import Any, BinaryIO, ParamSpec, TypeAlias, TypeVar

from yawid.runs.stop import SIGNALS
from yawid.system.child import DiedError, Worker
from yawid.system.part_file import Disk, sync
from yawid.system.processes import block, cores

MOST_CHILDREN = 4
"""The most processes that make fits: each needs up to 95 MB of memory."""
FIT_S = 120.0
"""Time limit in s of a fit: a child that is stopped or hangs is killed then."""
HERE = "this process answers instead, which takes longer"
_P = ParamSpec("_P")
_T = TypeVar("_T")
_Calls: TypeAlias = "queue.SimpleQueue[tuple[Future[Any], Callable[[], Any]] | None]"


class WorkThread(Executor):
    """One thread that makes the calls it is given one after the other; futures hold their errors.

    The thread is a daemon, unlike those of ``ThreadPoolExecutor``: Python does not wait for it at
    exit, so that a second signal ends the process at once.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._calls: _Calls = queue.SimpleQueue()
        self._start(_run)

    @property
    def waiting(self) -> int:
        """The number of calls that wait for the present ones to end."""
        return self._calls.qsize()

    def submit(self, fn: Callable[_P, _T], /, *args: _P.args, **kwargs: _P.kwargs) -> "Future[_T]":
        """See :class:`concurrent.futures.Executor`."""
        future: Future[_T] = Future()
        self._calls.put((future, partial(fn, *args, **kwargs)))
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the threads after the calls they were given, or after the present ones.

        This returns at once.
        """
        with suppress(queue.Empty):
            while cancel_futures:
                self._calls.get_nowait()
        self._calls.put(None)

    def _start(self, run: Callable[[_Calls], None]) -> None:
        threading.Thread(target=run, args=(self._calls,), name=self._name, daemon=True).start()


class FitWorker(WorkThread):
    """A worker whose calls are made by child processes once :meth:`spread` was called.

    A fit holds Python's lock nearly all the time, so that threads would share one core. Children
    begin the calls in the order given, and return what this process would. Where one ends without
    a result, this process makes the call, and ``say`` is given a line.
    """

    def __init__(self, name: str, say: Callable[[str], None]) -> None:
        super().__init__(name)
        self._say = say
        self._children: list[_ByChild] = []

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """See :class:`WorkThread`; with ``cancel_futures`` hung children are killed, too."""
        super().shutdown(wait, cancel_futures=cancel_futures)
        for each in self._children if cancel_futures else ():
            each.child.end()  # its call gets no answer

    def spread(self) -> None:
        """Start a child for each core; only the first call of this does anything."""
        if self._children:
            return
        self._calls.put(None)  # the thread ends after the calls that it has
        self._calls = queue.SimpleQueue()
        self._children = [_ByChild(self._say) for _ in range(min(cores(), MOST_CHILDREN))]
        for each in self._children:
            self._start(each.run)


class _ByChild:
    """Makes calls by a child process, and in this process once that has failed."""

    def __init__(self, say: Callable[[str], None]) -> None:
        self._say = say
        self.child = Worker("yawid.pipeline")
        self._is_lost = False

    def run(self, calls: _Calls) -> None:
        """Start the child, make the calls, and end it."""
        block(SIGNALS)  # the child inherits that: no Ctrl-C in the terminal reaches it
        self._tried(self.child.start)
        while (call := calls.get()) is not None:
            future, act = call
            _do(future, partial(self._made, act))
        calls.put(None)  # for the other threads
        self.child.close()

    def _made(self, act: Callable[[], _T]) -> _T:
        if not self._is_lost:
            found = self._tried(lambda: (self.child.call(act, FIT_S),))
            if found is not None:
                return found[0]
            if self.child.is_over:
                raise CancelledError
        return act()

    def _tried(self, ask: Callable[[], _T]) -> _T | None:
        """Return what the child answers, or None after a line that says why it does not."""
        try:
            return ask()
        except (DiedError, OSError) as error:
            self._is_lost = True
            how = f"cannot be started ({error})" if isinstance(error, OSError) else error
            if not self.child.is_over:
                self._say(f"a process that answers manoeuvres {how}: {HERE}")
            return None


def _run(calls: _Calls) -> None:
    while (call := calls.get()) is not None:
        _do(*call)


def _do(future: "Future[_T]", act: Callable[[], _T]) -> None:
    try:
        future.set_result(act())
    except BaseException as error:
        future.set_exception(error)


class SharedDisk(Disk):
    """A disk whose files a thread synchronises, which takes milliseconds: the loop does not wait.

    Each file waits once at most; what is written after that is for the next call.
    """

    def __init__(self, worker: Executor) -> None:
        self._worker = worker
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
        self._syncing[stream] = self._worker.submit(_sync_and_close, os.dup(stream.fileno()))

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
