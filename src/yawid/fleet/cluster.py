"""The workers of a Dask scheduler that somebody else runs.

A worker that dies takes no log with it: Dask gives what it held to another one.
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
LOOK_S: Final = 1.0
"""How often the number of workers is asked for."""
CONNECT_S: Final = 5.0
MOST_TRIES: Final = 3
"""Dask gives a log up whose workers died again and again; as often it is handed in anew."""


class Workers:
    """Workers to hand logs to; ``address`` is the scheduler's, ``threads`` are theirs at last."""

    def __init__(self, client: Any, address: str) -> None:
        self._client = client
        self.address = address
        self.threads = 0
        self._look_s = 0.0

    def run(
        self, tasks: Iterable[Task], stop: StopFlag
    ) -> Generator[tuple[Task, Any] | None, None, None]:
        """Yield each task as it ends, with its rows; fewer, once told to ``stop``.

        While none ends None comes, some times a second. Rows are None where a machine has no such
        file, a text where the workers died.

        Raises:
            SinkError: the scheduler is lost.
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
            if task is None:  # it was handed in anew
                continue
            try:
                rows = future.result(timeout=RESULT_S)
            except KilledWorker:
                tries += 1
                if tries < MOST_TRIES:
                    again.append((task, tries))
                    continue
                rows = "its workers died, again and again"
            except (TimeoutError, CancelledError, UnboundLocalError, CommClosedError):
                # It was lost with its worker, or with the scheduler, which the client is to notice;
                # Dask trips over that in several ways.
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
        """Return how many logs may be with the workers at once; none where there is no worker."""
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
            f"the scheduler at {self.address} is lost: what is finished is kept; "
            "start it and say the same again"
        )


def check_installed() -> None:
    """Look whether Dask is there, without the time its import takes.

    Raises:
        ConfigError: it is not.
    """
    if importlib.util.find_spec("distributed") is None:
        raise ConfigError("--scheduler needs Dask: pip install 'yawid[fleet]'")


@contextmanager
def workers_of(address: str) -> Iterator[Workers]:
    """Use the workers of the scheduler at an address.

    Raises:
        SinkError: nobody answers there, or its workers have another yawid.
    """
    import dask
    from distributed import Client

    for name in list(logging.root.manager.loggerDict):
        if name.startswith("distributed"):  # what is to be said of it, this module says
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
    """Have each machine compile once, before its workers would, all at the same time."""
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
