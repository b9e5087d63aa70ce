"""A Dask cluster on 127.0.0.1, whose scheduler and workers are separate processes; bad logs."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path

from checks.children import LIMIT_S, child
from data_sets import merge
from flights.long_log import START_US, write_log

from yawid.dataset.files import read_table
from yawid.dataset.schema import TABLES
from yawid.fleet.find_logs import find_logs
from yawid.fleet.one_log import rows_of
from yawid.fleet.run_fleet import with_keys
from yawid.fleet.spec import Spec

CLUSTER_S = 600.0
"""Time limit of a cluster in s, which serves a whole file of tests."""
MONTH_US = 31 * 86_400 * 10**6
HOOK = """
import os, signal, sys, time

def bad(event, arguments):
    if event == "open" and isinstance(arguments[0], (str, os.PathLike)):
        name = os.fspath(arguments[0])
        if "killer" in name:
            os.kill(os.getpid(), signal.SIGSEGV)
        if "stops" in name:
            os.kill(os.getpid(), signal.SIGSTOP)
        if "hangs" in name:
            open(os.path.join(os.path.dirname(__file__), f"hung-{os.getpid()}"), "w").close()
            time.sleep(3600)

if "yawid.fleet.one_log" in sys.orig_argv:
    sys.addaudithook(bad)
"""
"""Makes a log kill, stop or block the child that opens it. No log is known to do so, but one may.
A child that is blocked leaves a file ``hung-PID`` next to the hook."""


@dataclass
class Cluster:
    """A scheduler and its address."""

    address: str
    scheduler: subprocess.Popen[bytes]


def make_logs(folder: Path, count: int) -> None:
    """Write logs of 14 to 20 s, with dates in five months."""
    folder.mkdir(parents=True)
    for i in range(count):
        start_us = START_US + (i % 5) * MONTH_US + i * 10**9
        path = folder / f"{i:02d}.tlog"
        moved_s = 0.0 if i % 4 else 6.0  # fits cost time
        write_log(path, (14 + i % 7) / 3600, i, moved_s, 60.0, start_us=start_us)


def one_process(paths: Sequence[str], out: Path) -> None:
    """Make a data set of logs in this process, without workers, as the expected result."""
    spec, logs = Spec(), find_logs(paths)
    merge(out, [with_keys(log, rows_of(Path(log.path), spec), spec) for log in logs])


def tables(folder: Path) -> dict[str, list[dict[str, object]]]:
    """Return all rows of a data set by table."""
    return {name: read_table(folder, name).to_pylist() for name in TABLES}


def environment(folder: Path) -> dict[str, str]:
    """Return the environment of processes in which bad logs take effect."""
    folder.mkdir(exist_ok=True)
    (folder / "sitecustomize.py").write_text(HOOK, encoding="utf-8")
    paths = [str(folder), *filter(None, [os.environ.get("PYTHONPATH")])]
    return os.environ | {"PYTHONPATH": os.pathsep.join(paths)}


def yawid_fleet(
    env: dict[str, str], *arguments: str | Path, within_s: float = LIMIT_S
) -> AbstractContextManager[subprocess.Popen[str]]:
    """Start ``yawid fleet`` as a process with a process group of its own."""
    command = [sys.executable, "-m", "yawid", "fleet", *map(str, arguments)]
    pipe = subprocess.PIPE
    return child(
        command, within_s, env=env, stdout=pipe, stderr=pipe, text=True, start_new_session=True
    )


@contextmanager
def cluster(env: dict[str, str], folder: Path, workers: int = 2) -> Iterator[Cluster]:
    """Start a scheduler and workers in ``folder``, and end them with the context."""
    folder.mkdir()
    told = folder / "scheduler.json"
    options = ["--no-dashboard", "--host", "127.0.0.1", "--scheduler-file", str(told)]
    with _process("dask_scheduler", [*options, "--port", "0"], env, folder) as scheduler:
        while not (told.exists() and told.read_bytes().rstrip().endswith(b"}")):
            assert scheduler.poll() is None
            time.sleep(0.05)
        options += ["--nworkers", str(workers), "--nthreads", "1", "--local-directory", str(folder)]
        with _process("dask_worker", options, env, folder):
            yield Cluster(json.loads(told.read_bytes())["address"], scheduler)


@contextmanager
def _process(
    name: str, options: list[str], env: dict[str, str], folder: Path
) -> Iterator[subprocess.Popen[bytes]]:
    command = [sys.executable, "-m", f"distributed.cli.{name}", *options]
    with (
        (folder / f"{name}.txt").open("wb") as said,
        child(command, CLUSTER_S, env=env, stdout=said, stderr=said) as process,
    ):
        yield process
