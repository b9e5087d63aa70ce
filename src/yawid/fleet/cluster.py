"""The workers of a Dask scheduler that runs outside of yawid.

No log is lost when a worker dies: Dask gives its logs to another worker.
"""

import importlib.util
import logging
import queue
import time
from asyncio import CancelledError
from collections import deque
from collections.abc import Generator, Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from typing import Any, Final

from yawid.errors import ConfigError, SinkError
from yawid.fleet.worker import POLL_S, QUEUED, Task, about, warm, work
from yawid.runs.stop import StopFlag
from yawid.version import __version__

RESULT_S: Final = 10.0
"""Time limit in s for fetching the result of a task that has ended."""
LOOK_S: Final = 1.0
"""Interval in s at which the scheduler is asked for its number of threads."""
CONNECT_S: Final = 5.0
"""Time limit in s for connecting to the scheduler."""
MOST_TRIES: Final = 3
"""A log is given up after so many reports by Dask that several workers died of it."""


class Workers:
    """The workers of the scheduler at ``address``; ``threads`` is how many they last had."""

    def __init__(self, client: Any, address: str) -> None:
        self._client = client
        self.address = address
        self.threads = 0
        self._look_s = 0.0

    def run(
        self, tasks: Iterable[Task], stop: StopFlag
    ) -> Generator[tuple[Task, Any] | None, None, None]:
        """Yield each task with its rows when it ends; after ``stop`` is set, yield no more.

        While no task ends, yield None every ``POLL_S`` seconds. Rows are None if a worker's machine
        has no such file, and a text if the workers died.

        Raises:
            SinkError: the connection to the scheduler is lost, or a worker failed.
        """
        from distributed.comm.core import CommClosedError
        from distributed.scheduler import KilledWorker

        done: queue.SimpleQueue[Any] = queue.SimpleQueue()
        waiting, again = ((task, 0) for task in tasks), deque[tuple[Task, int]]()
        upcoming, flying = next(waiting, None), dict[Any, tuple[Task, int]]()
        while not stop.is_set:
            room = self._room() - len(flying)
            while room > 0 and (again or upcoming):
                if upcoming and not again:
                    again.append(upcoming)
                    upcoming = next(waiting, None)
                given = again.popleft()
                flying[self._submit(given[0], done)] = given
                room -= 1
            if not (flying or again or upcoming):
                return
            try:
                future = done.get(timeout=POLL_S)
            except queue.Empty:
                yield None
                continue
            task, tries = flying.pop(future, (None, 0))
            if task is None:  # it was submitted again, as a new future
                continue
            try:
                rows = future.result(timeout=RESULT_S)
            except KilledWorker:
                tries += 1
                if tries < MOST_TRIES:
                    again.append((task, tries))
                    continue
                rows = "its workers died several times"
            except (TimeoutError, CancelledError, UnboundLocalError, CommClosedError):
                # The result was lost with its worker, or the scheduler is lost, which _check sees
                # from the client's status. Dask raises any of these errors then.
                self._check()
                again.append((task, tries))
                continue
            except Exception as error:
                self._check()
                raise SinkError(f"a worker failed: {type(error).__name__}: {error}") from error
            future.release()
            yield task, rows

    def _submit(self, task: Task, done: "queue.SimpleQueue[Any]") -> Any:
        try:
            future = self._client.submit(work, task, pure=False)
        except Exception as error:
            raise self._lost() from error
        future.add_done_callback(done.put)
        return future

    def _room(self) -> int:
        """Return how many logs the workers may hold at once: 0 while there is no worker."""
        self._check()
        if time.monotonic() >= self._look_s:
            try:
                threads = self._client.nthreads()
            except Exception as error:
                raise self._lost() from error
            self.threads = sum(threads.values())
            self._look_s = time.monotonic() + LOOK_S
        return QUEUED * self.threads

    def _check(self) -> None:
        if self._client.status != "running":
            raise self._lost()

    def _lost(self) -> SinkError:
        return SinkError(
            f"Lost the scheduler at {self.address}. Finished logs are saved: start it again and "
            "repeat the command."
        )


def check_installed() -> None:
    """Check that Dask is installed, without importing it, which takes long.

    Raises:
        ConfigError: Dask is not installed.
    """
    if importlib.util.find_spec("distributed") is None:
        raise ConfigError("--scheduler needs Dask: pip install 'yawid[fleet]'")


@contextmanager
def workers_of(address: str) -> Iterator[Workers]:
    """Connect to the scheduler at ``address`` and use its workers.

    Raises:
        SinkError: no scheduler answers there, or its workers cannot import yawid or have another
            version of it.
    """
    import dask
    from distributed import Client

    for name in list(logging.root.manager.loggerDict):
        if name.startswith("distributed"):  # this module reports errors in its own words
            logging.getLogger(name).setLevel(logging.CRITICAL)
    settings = {
        "distributed.comm.timeouts.connect": f"{CONNECT_S:g}s",
        "distributed.client.scheduler-info-interval": "2s",
    }
    with ExitStack() as stack:
        stack.enter_context(dask.config.set(settings))
        try:
            client = Client(address, set_as_default=False, timeout=CONNECT_S)
        except (OSError, TimeoutError, ValueError) as error:
            text = f"no Dask scheduler answers at {address}"
            raise SinkError(f"{text}: {str(error) or type(error).__name__}") from error
        stack.enter_context(_closing(client))
        _make_ready(client)
        yield Workers(client, address)


@contextmanager
def _closing(client: Any) -> Iterator[None]:
    try:
        yield
    finally:
        with suppress(Exception):  # the scheduler may be lost
            client.close(timeout=2)


def _make_ready(client: Any) -> None:
    """Check the workers' versions, and compile once on each machine before its workers start.

    Without this, all workers of a machine would compile at the same time.
    """
    try:
        found = client.run(about)
    except Exception as error:
        raise SinkError(f"the workers cannot run yawid {__version__}: {error}") from error
    for worker, versions in found.items():
        if versions["yawid"] != __version__:
            raise SinkError(
                f"the worker at {worker} has yawid {versions['yawid']}, here is {__version__}"
            )
    one_of = {worker.rpartition(":")[0]: worker for worker in found}
    with suppress(Exception):  # the scheduler may be lost
        client.run(warm, workers=list(one_of.values()))
