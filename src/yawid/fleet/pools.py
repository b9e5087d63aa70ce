"""Workers: threads of this machine, or those of a Dask scheduler that runs outside of yawid.

Threads open no port and take work from no other process. Dask's local workers would open a port
each, and its status page one that the whole network can reach.
"""

import importlib.util
import logging
import queue
import shutil
from asyncio import CancelledError
from collections.abc import Generator, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from itertools import chain, islice
from pathlib import Path
from typing import Any, Final

from yawid.dataset.values import failed
from yawid.errors import ConfigError, SinkError
from yawid.fleet.worker import OWN, REPLAYS, Task, ready, replayed, replayed_in_dask, warm
from yawid.runs.stop import SIGNALS, StopFlag
from yawid.system.child import Worker
from yawid.system.processes import block, cores
from yawid.version import __version__

QUEUED, POLL_S = 2, 0.1
"""How many logs a worker holds (it replays one, one waits); the longest wait for a result in s."""
RESULT_S: Final = 10.0
"""Time limit in s for fetching the result of a task that has ended."""
CONNECT_S: Final = 5.0
"""Time limit in s for connecting to the scheduler."""
LOST: Final = object()
"""In place of rows: the worker that had them is lost, and the log is to be run again."""


class Here:
    """Threads of this process, each with a process that replays logs."""

    def __init__(self, threads: int, copies: Path) -> None:
        self.threads, self._copies = threads, copies
        self._workers = [Worker(REPLAYS) for _ in range(threads)]
        unused = iter(self._workers)
        self._pool = ThreadPoolExecutor(threads, "yawid-fleet", self._begin, (unused,))

    @staticmethod
    def _begin(unused: Iterator[Worker]) -> None:
        block(SIGNALS)
        OWN.worker = next(unused)

    def submit(self, task: Task) -> Any:
        """Return a future of a log's rows."""
        return self._pool.submit(replayed, task, self._copies)

    def rows(self, future: Any) -> Any:
        """Return the rows of a future that has ended."""
        return future.result()

    def end(self) -> None:
        """Kill all processes and drop the logs that are not finished."""
        self._pool.shutdown(wait=False, cancel_futures=True)
        for worker in self._workers:
            worker.end()
        self._pool.shutdown()
        for worker in self._workers:
            worker.close()


class Cluster:
    """The workers of the Dask scheduler at ``address``.

    A log whose worker dies is given to another one.

    Raises:
        SinkError: they cannot import yawid or have another version of it.
    """

    def __init__(self, client: Any, address: str) -> None:
        self._client, self._address = client, address
        try:  # one of each machine: all would compile at the same time, each in half a gigabyte
            one_of = {worker.rpartition(":")[0]: worker for worker in client.nthreads()}
            found = client.run(ready, workers=[*one_of.values()])
        except Exception as error:
            raise SinkError(f"the workers cannot run yawid {__version__}: {error}") from error
        for worker, its in found.items():
            if its != __version__:
                raise SinkError(f"the worker at {worker} has yawid {its}, here is {__version__}")

    @property
    def threads(self) -> int:
        """The number of the workers' threads.

        Raises:
            SinkError: the connection to the scheduler is lost.
        """
        with self._connected():
            return sum(self._client.nthreads().values())

    def submit(self, task: Task) -> Any:
        """Return a future of a log's rows. Raises as :attr:`threads` does."""
        with self._connected():
            return self._client.submit(replayed_in_dask, task, pure=False)

    def rows(self, future: Any) -> Any:
        """Return the rows of a future that has ended, or ``LOST``."""
        from distributed.comm.core import CommClosedError
        from distributed.scheduler import KilledWorker

        try:
            return future.result(timeout=RESULT_S)
        except KilledWorker:
            return failed("crashed", "its workers died several times")
        except (TimeoutError, CancelledError, UnboundLocalError, CommClosedError):
            # The result was lost with its worker, or the scheduler is lost, which shows in the
            # client's status. Dask raises any of these errors then.
            with self._connected():
                return LOST
        finally:
            future.release()

    @contextmanager
    def _connected(self) -> Iterator[None]:
        lost = SinkError(
            f"Lost the scheduler at {self._address}. Finished logs are saved: start it again and "
            "repeat the command."
        )
        if self._client.status != "running":
            raise lost
        try:
            yield
        except Exception as error:  # Dask raises many kinds
            raise lost from error


def ended_logs(
    pool: Here | Cluster, tasks: Iterable[Task], stop: StopFlag
) -> Generator[tuple[Task, Any] | None, None, None]:
    """Yield each task with its rows when it ends; after ``stop`` is set, yield no more.

    While no task ends, yield None every ``POLL_S`` seconds.

    Raises:
        SinkError: the connection to a scheduler is lost, or a worker failed.
    """
    done: queue.SimpleQueue[Any] = queue.SimpleQueue()
    waiting, flying = iter(tasks), dict[Any, Task]()
    while not stop.is_set:
        room = QUEUED * pool.threads - len(flying)
        for task in islice(waiting, max(room, 0)):
            future = pool.submit(task)
            flying[future] = task
            future.add_done_callback(done.put)
        if room > 0 and not flying:
            return
        try:
            future = done.get(timeout=POLL_S)
        except queue.Empty:
            yield None
            continue
        try:
            ended, rows = flying.pop(future), pool.rows(future)
        except SinkError:
            raise
        except Exception as error:
            raise SinkError(f"a worker failed: {type(error).__name__}: {error}") from error
        if rows is LOST:
            waiting = chain([ended], waiting)
        else:
            yield ended, rows


@contextmanager
def workers_here(count: int | None, copies: Path) -> Iterator[Here]:
    """Start ``count`` workers, by default one for each core that this process may use.

    The folder ``copies`` is theirs: what is in it, by a fleet that was killed, is removed.
    When the context ends, their processes are killed and unfinished logs are dropped. The threads
    block the signals that end a run; the processes inherit this, so that a Ctrl-C in the terminal,
    which goes to all its processes, does not reach them.
    """
    warm()
    shutil.rmtree(copies, ignore_errors=True)
    copies.mkdir()
    here = Here(count or cores(), copies)
    try:
        yield here
    finally:
        here.end()
        shutil.rmtree(copies, ignore_errors=True)


def check_installed() -> None:
    """Check that Dask is installed, without importing it, which takes long.

    Raises:
        ConfigError: Dask is not installed.
    """
    if importlib.util.find_spec("distributed") is None:
        raise ConfigError("--scheduler needs Dask: pip install 'yawid[fleet]'")


@contextmanager
def workers_of(address: str) -> Iterator[Cluster]:
    """Connect to the scheduler at ``address`` and use its workers.

    Raises:
        SinkError: no scheduler answers there, or its workers cannot import yawid or have another
            version of it.
    """
    import dask
    from distributed import Client

    for name in ("distributed", "distributed.client", "distributed.gc"):
        logging.getLogger(name).setLevel(logging.CRITICAL)  # this module reports errors itself
    with dask.config.set({"distributed.comm.timeouts.connect": f"{CONNECT_S:g}s"}):
        try:
            client = Client(address, set_as_default=False, timeout=CONNECT_S)
        except (OSError, TimeoutError, ValueError) as error:
            text = f"no Dask scheduler answers at {address}"
            raise SinkError(f"{text}: {str(error) or type(error).__name__}") from error
        try:
            yield Cluster(client, address)
        finally:
            with suppress(Exception):  # the scheduler may be lost
                client.close(timeout=2)
