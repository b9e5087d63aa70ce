"""The workers of this machine: threads, each with a child process that replays logs.

They open no port and take work from no other process. Dask's local workers would open a port each,
and its status page one that the whole network can reach.
"""

import queue
import threading
from collections.abc import Generator, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from itertools import islice
from typing import Any, Final

from yawid.errors import SinkError
from yawid.fleet.worker import POLL_S, QUEUED, Replayer, Task, scratch_folder, warm
from yawid.runs.stop import SIGNALS, StopFlag
from yawid.system.processes import block, cores

HERE: Final = "this machine"


class LocalWorkers:
    """A pool of ``threads`` threads with one child process each; :meth:`run` gives them logs."""

    address = HERE

    def __init__(self, pool: ThreadPoolExecutor, children: list[Replayer]) -> None:
        self._pool = pool
        self._idle: queue.SimpleQueue[Replayer] = queue.SimpleQueue()
        for child in children:
            self._idle.put(child)
        self.threads = len(children)

    def run(
        self, tasks: Iterable[Task], stop: StopFlag
    ) -> Generator[tuple[Task, Any] | None, None, None]:
        """Yield each task with its rows when it ends; after ``stop`` is set, yield no more.

        While no task ends, yield None every ``POLL_S`` seconds. Rows are None if the file does not
        exist.

        Raises:
            SinkError: a child process cannot be started.
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
    """Start ``count`` workers, by default one for each core that this process may use.

    When the context ends, the children are killed and unfinished logs are dropped. The threads
    block the signals that end a run; the children inherit this, so that a Ctrl-C in the terminal,
    which goes to all its processes, does not reach them.
    """
    ready = threading.Thread(target=warm)
    ready.start()
    with scratch_folder() as scratch:
        children = [Replayer(scratch) for _ in range(count or cores())]
        pool = ThreadPoolExecutor(len(children), "yawid-fleet", block, (SIGNALS,))
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
