"""Processes that make calls: whatever a call does to its process, it ends in time; none stays."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import psutil
import pytest
from checks.children import child

from yawid.system.child import DiedError, LateError, Worker

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="no such signals there")
LIMIT_S, MORE_S = 1.0, 5.0


def to_self(number: int) -> Callable[[], Any]:
    """Return a call that sends a signal to its own process."""
    return partial(signal.raise_signal, number)


@contextmanager
def in_time(kind: type[Exception]) -> Iterator[pytest.ExceptionInfo[Exception]]:
    """Assert that a call raises this, soon after its limit."""
    begin_s = time.monotonic()
    with pytest.raises(kind) as said:
        yield said
    assert time.monotonic() - begin_s < LIMIT_S + MORE_S


@pytest.fixture
def worker() -> Any:
    """A worker of which no process is left at the end."""
    before = {each.pid for each in psutil.Process().children()}
    made = Worker("json")
    yield made
    made.close()
    left = [each for each in psutil.Process().children() if each.pid not in before]
    assert [each for each in left if "json" in each.cmdline()] == []


@pytest.mark.parametrize(
    ("act", "kind", "how"),
    [
        (to_self(signal.SIGKILL), DiedError, "was killed by SIGKILL"),
        (to_self(signal.SIGSEGV), DiedError, "was killed by SIGSEGV"),
        (to_self(signal.SIGSTOP), LateError, "was killed by SIGKILL"),
        (partial(time.sleep, 3600), LateError, "was killed by SIGKILL"),
        (partial(os._exit, 3), DiedError, "ended with exit code 3"),
        (partial(int, "no number"), DiedError, "ended with exit code 1"),
    ],
)
def test_a_call_that_kills_stops_or_hangs_its_process_ends_in_time_and_the_next_one_is_made(
    worker: Worker, act: Callable[[], Any], kind: type[DiedError], how: str
) -> None:
    first = worker.call(os.getpid, 60.0)
    with in_time(kind) as said:
        worker.call(act, LIMIT_S)
    assert (type(said.value), str(said.value)) == (kind, how)
    assert not psutil.pid_exists(first)
    assert worker.call(os.getpid, 60.0) != first


@pytest.mark.parametrize("number", [signal.SIGSTOP, signal.SIGKILL])
def test_a_process_that_is_stopped_or_killed_between_two_calls_ends_in_time(
    worker: Worker, number: signal.Signals
) -> None:
    os.kill(worker.call(os.getpid, 60.0), number)
    with in_time(DiedError):
        worker.call(os.getpid, LIMIT_S)
    assert worker.call(partial(int, "7"), 60.0) == 7


def test_a_call_is_ended_from_another_thread_and_none_is_made_after_it(worker: Worker) -> None:
    worker.start()
    threading.Timer(0.2, worker.end).start()
    for _ in range(2):
        with in_time(DiedError):
            worker.call(partial(time.sleep, 3600), 3600.0)


PARENT = """
from yawid.system.child import Worker
Worker("stopping").start()
"""


@pytest.mark.skipif(sys.platform != "linux", reason="prctl is Linux's")
def test_a_process_that_is_stopped_while_it_starts_ends_with_its_killed_parent(
    tmp_path: Path,
) -> None:
    stopping = "import os, signal; os.kill(os.getpid(), signal.SIGSTOP)\n"
    (tmp_path / "stopping.py").write_text(stopping, encoding="utf-8")
    with child(
        [sys.executable, "-c", PARENT], env=os.environ | {"PYTHONPATH": str(tmp_path)}
    ) as by:
        end_s, made = time.monotonic() + 30.0, psutil.Process(by.pid)
        while not any(each.status() == psutil.STATUS_STOPPED for each in made.children()):
            assert time.monotonic() < end_s
            time.sleep(0.02)
        below = made.children()
        by.kill()
        by.wait(30.0)
    _, alive = psutil.wait_procs(below, timeout=MORE_S)
    assert alive == []


def test_a_process_that_cannot_import_its_module_says_so() -> None:
    with pytest.raises(OSError, match=r"-m yawid\.system\.child no_such_module ended with exit"):
        Worker("no_such_module").call(int, 60.0)
