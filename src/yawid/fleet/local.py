"""Workers of this machine: threads, each with a child process that replays.

They listen nowhere and take work from no other process; Dask's own would open a port each, and its
status page one for the whole network.
"""

import os
import queue
import signal
import threading
from collections.abc import Generator, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from itertools import islice
from typing import Any, Final

from yawid.errors import SinkError
from yawid.fleet.worker import POLL_S, QUEUED, Child, Task, warm
from yawid.runs.stop import SIGNALS, StopFlag

HERE: Final = "this machine"


class LocalWorkers:
    """As many threads as children; ``run`` hands them logs."""

    address = HERE

    def __init__(self, pool: ThreadPoolExecutor, children: list[Child]) -> None:
        self._pool = pool
        self._idle: queue.SimpleQueue[Child] = queue.SimpleQueue()
        for child in children:
            self._idle.put(child)
        self.threads = len(children)

    def run(
        self, tasks: Iterable[Task], stop: StopFlag
    ) -> Generator[tuple[Task, Any] | None, None, None]:
        """Yield each task as it ends, with its rows; fewer, once told to ``stop``.

        While none ends None comes, some times a second. Rows are None where there is no such file.

        Raises:
            SinkError: a child process does not even start.
        """
        done: queue.SimpleQueue[Future[Any]] = queue.SimpleQueue()
        waiting, flying = iter(tasks), dict[Future[Any], Task]()
        while not stop.is_set:
            for task in islice(waiting, QUEUED * self.threads - len(flying)):
                future = self._pool.submit(self._work, task)
                flying[future] = task
                future.add_done_callback(done.put)
            if not flying:
                return
            try:
                future = done.get(timeout=POLL_S)
            except queue.Empty:
                yield None
                continue
            try:
                rows = future.result()
            except Exception as error:
                raise SinkError(f"a worker failed: {type(error).__name__}: {error}") from error
            yield flying.pop(future), rows

    def _work(self, task: Task) -> Any:
        child = self._idle.get()
        try:
            return child.rows(task)
        finally:
            self._idle.put(child)


@contextmanager
def local_workers(count: int | None) -> Iterator[LocalWorkers]:
    """Start ``count`` workers, as many as this process may use cores; end them with what they do.

    The threads block the signals that end a run, so that their children, which inherit that, never
    see what a terminal sends to all its processes.
    """
    ready = threading.Thread(target=warm)
    ready.start()
    children = [Child() for _ in range(count or len(os.sched_getaffinity(0)))]
    pool = ThreadPoolExecutor(
        len(children), "yawid-fleet", signal.pthread_sigmask, (signal.SIG_BLOCK, SIGNALS)
    )
    ready.join()
    try:
        yield LocalWorkers(pool, children)
    finally:
        pool.shutdown(wait=False, cancel_futures=True)
        for child in children:
            child.end()
        pool.shutdown()
        for child in children:
            child.close()
