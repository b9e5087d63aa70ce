"""Data sets whose writer is ended by kill -9 before its n-th step, of SQL or on disk."""

from __future__ import annotations

import json
import os
import shutil
import signal
import sqlite3
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from data_sets import merge

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
