"""Data sets written row by row, without logs, also by writers that are ended by kill -9."""

from __future__ import annotations

import json
import os
import shutil
import signal
import sqlite3
import subprocess
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from yawid.dataset.files import DataSet

MADE_BY = {"yawid_version": "0", "analysis_version": "1", "config_hash": "c"}
MAY, JUNE = 1_780_000_000_000_000, 1_782_000_000_000_000  # 2026-05-28, 2026-06-21


def entry(path: str, sha: str | None, *dates: int | None, **values: Any) -> Any:
    """Return a log's rows: a boot for each of ``dates``, which may be None."""
    log = {"path": path, "log_sha256": sha, "outcome": "ok" if sha else "crashed", **MADE_BY}
    keys = {"log_sha256": sha, "sysid": 1, "vehicle": "sysid:1", "usable": True, **MADE_BY}
    flights = [{**keys, "boot": i, "date": date, **values} for i, date in enumerate(dates, 1)]
    return {"logs": [log], "flights": flights}


def merge(folder: Path, entries: Iterable[Any]) -> None:
    """Put logs with all their rows into a data set, as a fleet does."""
    with DataSet(folder) as data:
        for each in entries:
            data.add(each)


MOST_S = 120.0
STEPS = ("os.rename", "os.remove", "os.mkdir", "open")


def killed_at_every_step(start: Path, entries: Sequence[Any], into: Path) -> list[Path]:
    """Put entries into copies of ``start``; the n-th writer is killed before its n-th step.

    Return the folders of the copies. The last writer was not killed, as it has no such step. One
    process forks for all of them.
    """
    command = [sys.executable, __file__, str(start), str(into)]
    done = subprocess.run(
        command, input=json.dumps(entries).encode(), capture_output=True, timeout=MOST_S, check=True
    )
    return [Path(name) for name in done.stdout.decode().splitlines()]


def _main(start: Path, into: Path) -> None:
    entries, step, is_killed = json.load(sys.stdin), 0, True
    merge(into / "warm", entries)  # so that late imports are done before the forks
    while is_killed:
        step += 1
        folder = into / f"{step}"
        shutil.copytree(start, folder)
        child = os.fork()
        if not child:
            _count_to(step, folder)
            merge(folder, entries)
            os._exit(0)
        _, status = os.waitpid(child, 0)
        is_killed = os.WIFSIGNALED(status) and os.WTERMSIG(status) == signal.SIGKILL
        assert is_killed or status == 0
        print(folder, flush=True)


def _count_to(step: int, folder: Path) -> None:
    left = [step]

    def count(*_: object) -> None:
        left[0] -= 1
        if left[0] == 0:
            os.kill(os.getpid(), signal.SIGKILL)

    def event(name: str, arguments: tuple[Any, ...]) -> None:
        path = arguments[0] if arguments else None
        if name in STEPS and isinstance(path, str | os.PathLike) and str(folder) in os.fspath(path):
            count()

    def connect(*arguments: Any, **named: Any) -> sqlite3.Connection:
        database = connected(*arguments, **named)
        database.set_trace_callback(count)
        return database

    connected, sqlite3.connect = sqlite3.connect, connect
    sys.addaudithook(event)


if __name__ == "__main__":
    _main(Path(sys.argv[1]), Path(sys.argv[2]))
