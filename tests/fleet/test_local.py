"""The workers of this machine: nothing of them listens, and they end with the command."""

from __future__ import annotations

import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import psutil
import pytest
from fleet_cluster import environment, make_logs, yawid_fleet
from places import REPLAY_LOGS

from yawid.cli.main import main
from yawid.fleet.worker import warm

LISTENS_TCP, ACCEPTS_UNIX = "0A", 0x10000
"""How /proc/net/tcp and /proc/net/unix mark a socket that others can connect to."""


def listening(processes: list[psutil.Process]) -> list[str]:
    """Return the sockets of the processes that take connections or datagrams, by the kernel."""
    own = set()
    for process in processes:
        for place in Path(f"/proc/{process.pid}/fd").iterdir():
            try:
                own.add(str(place.readlink()))
            except FileNotFoundError:
                continue  # closed meanwhile
    found = []
    for name in ("tcp", "tcp6", "udp", "udp6"):
        for line in Path(f"/proc/net/{name}").read_text(encoding="utf-8").splitlines()[1:]:
            field = line.split()
            is_open = name.startswith("udp") or field[3] == LISTENS_TCP
            if is_open and f"socket:[{field[9]}]" in own:
                found.append(f"{name} {field[1]}")
    for line in Path("/proc/net/unix").read_text(encoding="utf-8").splitlines()[1:]:
        field = line.split()
        if int(field[3], 16) & ACCEPTS_UNIX and f"socket:[{field[6]}]" in own:
            found.append(f"unix {field[7:]}")
    return found


@contextmanager
def hanging_fleet(place: Path) -> Iterator[subprocess.Popen[str]]:
    """Start a fleet whose two workers are at logs that never end."""
    make_logs(place / "made", 1)
    (place / "logs").mkdir()
    for i in range(3):
        shutil.copy(place / "made" / "00.tlog", place / "logs" / f"hangs{i}.tlog")
    env = environment(place / "hook")
    with yawid_fleet(env, place / "logs", "--out", place / "out", "--workers", "2") as run:
        yield run


def children_of(run: subprocess.Popen[str], hook: Path) -> list[psutil.Process]:
    """Return the processes below a fleet once both of its children are at logs that never end."""
    end_s = time.monotonic() + 60.0
    while True:
        assert run.poll() is None
        assert time.monotonic() < end_s
        below = psutil.Process(run.pid).children(recursive=True)
        if sum((hook / f"hung-{each.pid}").exists() for each in below) == 2:
            return below
        time.sleep(0.05)


def test_no_process_of_a_local_fleet_listens_and_ctrl_c_leaves_none_behind(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)):  # what is sought would be found
        assert len(listening([psutil.Process()])) == 1
    with hanging_fleet(tmp_path) as run:
        below = children_of(run, tmp_path / "hook")

        assert listening([psutil.Process(run.pid), *below]) == []

        os.killpg(run.pid, signal.SIGINT)  # as a terminal does
        said = run.communicate(timeout=120)
        assert run.returncode == 130, said
        assert "Traceback" not in said[1]
        assert [each for each in below if each.is_running()] == []


def test_a_python_that_may_not_be_executed_ends_a_fleet_with_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "python").touch(0o644)
    monkeypatch.setattr(sys, "executable", str(tmp_path / "python"))
    warm.cache_clear()

    assert main(["fleet", str(REPLAY_LOGS / "c172p_3211"), "--out", str(tmp_path / "data")]) == 6
    assert "Permission denied" in capsys.readouterr().err.splitlines()[-1]
