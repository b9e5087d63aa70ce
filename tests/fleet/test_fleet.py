"""The whole way through ``yawid fleet`` with real processes, real workers and real deaths."""

from __future__ import annotations

import os
import random
import shutil
import signal
import socket
import sqlite3
import sys
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import closing, suppress
from pathlib import Path

import psutil
import pytest
from fleet_cluster import (
    Cluster,
    cluster,
    environment,
    make_logs,
    one_process,
    tables,
    yawid_fleet,
)
from live_link import wait_until
from places import REPLAY_LOGS

from yawid.cli.main import main
from yawid.dataset.files import DATABASE, DataSet, peek, read_table
from yawid.fleet.worker import warm

COUNT = 8
NO_DISK = "/proc/self/mem"
"""Reading its first byte is an input/output error, as of a broken disk."""
OPEN = {(socket.AF_INET, socket.SOCK_DGRAM), (socket.AF_INET6, socket.SOCK_DGRAM),
        (socket.AF_UNIX, socket.SOCK_STREAM), (socket.AF_UNIX, socket.SOCK_DGRAM)}  # fmt: skip
"""Sockets to which others can send or connect as soon as they have a name."""


@pytest.fixture(scope="session")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("fleet")


@pytest.fixture(scope="session")
def logs(place: Path) -> Path:
    """A dozen logs: flights, two vehicles in one, one without a rudder, a copy, a text."""
    folder = place / "logs"
    make_logs(folder, COUNT)
    for name in ("two_vehicles", "no_rudder"):
        shutil.copy(REPLAY_LOGS / name / "log.tlog", folder / f"{name}.tlog")
    shutil.copy(folder / "03.tlog", folder / "copy.tlog")
    (folder / "text.tlog").write_text("no log\n", encoding="utf-8")
    return folder


@pytest.fixture(scope="session")
def reference(place: Path, logs: Path) -> Path:
    """The data set of the same logs, made in this process."""
    one_process([str(logs)], place / "reference")
    return place / "reference"


@pytest.fixture(scope="session")
def env(place: Path) -> dict[str, str]:
    return environment(place / "hook")


@pytest.fixture(scope="session")
def running(place: Path, env: dict[str, str]) -> Iterator[Cluster]:
    with cluster(env, place / "cluster") as found:
        yield found


def test_a_fleet_that_is_killed_goes_on_with_a_cluster_and_ends_with_the_rows_of_one_process(
    place: Path,
    logs: Path,
    reference: Path,
    env: dict[str, str],
    running: Cluster,
    capsys: pytest.CaptureFixture[str],
) -> None:
    out = place / "killed"
    with yawid_fleet(env, logs, "--out", out, "--workers", "2") as run:
        _wait_for_logs(out, 3)
        run.kill()
        run.communicate(timeout=60)
    done = len(peek(out))
    assert done >= 2  # the third may have been seen before its transaction ended

    assert main(["fleet", str(logs), "--out", str(out), "--scheduler", running.address]) == 0

    told = capsys.readouterr()
    assert f"{COUNT + 4 - done} logs to run, {done} known already" in told.err
    assert f"{out}: logs {COUNT + 4}, flights {COUNT + 3}" in told.out
    assert tables(out) == tables(reference)


AGAIN = "yawid: {} logs failed for a reason that may pass: repeat the command"
LATE, IRREGULAR = (
    "it did not finish within 3 s: allow more with --timeout",
    "it is not a regular file: only those are read",
)
BAD = {
    "hangs": ("timeout", LATE),
    "stops": ("timeout", LATE),
    "killer": ("crashed", "its process was killed by SIGSEGV, 3 times"),
    "dangling": ("failed", "No such file"),
    "loop": ("failed", "symbolic links"),
    "fifo": ("failed", IRREGULAR),
    "zero": ("failed", IRREGULAR),
    r"caf\udce9": ("failed", "its name is not UTF-8: rename the file or its folder"),
    "broken": ("failed", "broken.tlog cannot be read (Input/output error)"),
    "linked": ("unusable", "rudder"),
}
"""The outcome of what a folder of logs may hold, and its text."""


def test_a_bad_log_or_what_is_none_has_one_row_and_its_neighbours_have_theirs(
    place: Path, logs: Path, running: Cluster, capsys: pytest.CaptureFixture[str]
) -> None:
    bad, out, no_rudder = place / "bad", place / "by_bad", REPLAY_LOGS / "no_rudder" / "log.tlog"
    bad.mkdir()
    for name in ("killer", "hangs", "stops", "good", "next"):
        shutil.copy(logs / "00.tlog", bad / f"{name}.tlog")
    links = {"linked": no_rudder, "dangling": "nowhere", "loop": "loop.tlog", "zero": "/dev/zero",
             "broken": NO_DISK}  # fmt: skip
    for name, target in links.items():
        (bad / f"{name}.tlog").symlink_to(target)
    os.mkfifo(bad / "fifo.tlog")
    shutil.copy(no_rudder, bad / os.fsdecode(b"caf\xe9.tlog"))
    command = ["fleet", str(bad), "--out", str(out), "--scheduler", running.address]

    assert main([*command, "--timeout", "3"]) == 6

    told, whole = capsys.readouterr(), tables(out)
    assert told.err.splitlines()[-1].startswith(AGAIN.format(6))
    assert (told.out + told.err).isascii()
    rows = {Path(str(row["path"])).stem: row for row in whole["logs"]}
    good = rows["good"]["outcome"]
    assert good in ("ok", "unusable")
    outcomes = {name: row["outcome"] for name, row in rows.items()}
    assert outcomes == {name: outcome for name, (outcome, _) in BAD.items()} | {
        "good": good, "next": good,
    }  # fmt: skip
    assert [name for name, (_, text) in BAD.items() if text not in str(rows[name]["text"])] == []
    assert rows[r"caf\udce9"]["path"] == str(bad / r"caf\udce9.tlog")
    assert (rows["killer"]["reasons"], rows["broken"]["reasons"]) == (["crashed"], ["failed"])
    for words in (command, [*command, "--retry"], ["fleet", f"{bad}/*.tlog", *command[2:]]):
        assert main([*words, "--dry-run"]) == 0
    planned = capsys.readouterr().out.splitlines()
    assert [line.split(",")[0] for line in planned] == [f"to run: {n} logs" for n in (6, 9, 6)]

    (bad / "good.tlog").unlink()
    (bad / "good.tlog").symlink_to(NO_DISK)
    assert main(command) == 6
    assert AGAIN.format(7) in capsys.readouterr().err
    after = tables(out)  # takes no earlier answer away
    assert after["flights"] == whole["flights"]
    assert [row["outcome"] for row in after["logs"]] == [row["outcome"] for row in whole["logs"]]


def listening(processes: list[psutil.Process]) -> list[object]:
    """Return the sockets of the processes that take connections or datagrams from others."""
    found = [each for process in processes for each in process.net_connections("all")]
    return [
        each for each in found
        if each.status == "LISTEN" or (each.laddr and (each.family, each.type) in OPEN)
    ]  # fmt: skip


def test_no_process_of_a_local_fleet_listens_and_ctrl_c_keeps_what_is_finished_and_no_process(
    place: Path, logs: Path, env: dict[str, str]
) -> None:
    out, some, hook = place / "interrupted", place / "some", place / "hook"
    unix = str(place / "unix")
    with (  # what is sought would be found
        socket.create_server(("127.0.0.1", 0)),
        socket.socket(socket.AF_UNIX) as named,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as bound,
    ):
        named.bind(unix)
        bound.bind(("127.0.0.1", 0))
        assert len(listening([psutil.Process()])) == 3
    some.mkdir()
    for name in ("00", "01", "02"):
        shutil.copy(logs / f"{name}.tlog", some)
    for i in range(3):  # the smallest are run last
        (some / f"hangs{i}.tlog").write_bytes(b"x")
    with yawid_fleet(env, some, "--out", out, "--workers", "2") as run:
        below, end_s = list[psutil.Process](), time.monotonic() + 60.0
        while sum((hook / f"hung-{each.pid}").exists() for each in below) < 2:
            assert run.poll() is None
            assert time.monotonic() < end_s
            time.sleep(0.05)
            below = psutil.Process(run.pid).children(recursive=True)
        _wait_for_logs(out, 3)
        assert listening([psutil.Process(run.pid), *below]) == []
        os.killpg(run.pid, signal.SIGINT)  # as a terminal does
        said = run.communicate(timeout=120)

    assert run.returncode == 130, said
    assert len(read_table(out, "logs")) == 3
    told = "yawid: SIGINT: 3 logs are finished and saved, 3 were not reached"
    assert said[1].splitlines()[-1] == told
    assert "Traceback" not in said[1]
    assert [each for each in below if each.is_running()] == []


@pytest.mark.long
def test_a_scheduler_that_is_lost_ends_the_run_in_one_line_and_harms_nothing(
    place: Path, logs: Path, env: dict[str, str]
) -> None:
    out = place / "lost"
    with (
        cluster(env, place / "lost_cluster", workers=1) as found,
        yawid_fleet(env, logs, "--out", out, "--scheduler", found.address) as run,
    ):
        _wait_for_logs(out, 1)
        found.scheduler.kill()
        said = run.communicate(timeout=60)

    assert run.returncode == 6, said
    assert said[1].splitlines()[-1].startswith(f"yawid: Lost the scheduler at {found.address}.")
    assert "Traceback" not in said[1]
    counts = Counter(read_table(out, "logs")["path"].to_pylist())
    assert counts
    assert set(counts.values()) == {1}


def test_without_dask_its_scheduler_or_a_python_that_may_be_executed_one_line_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("yawid.fleet.pools.CONNECT_S", 0.5)
    command = ["fleet", str(REPLAY_LOGS / "no_rudder"), "--out", str(tmp_path / "data")]
    scheduler = "--scheduler", "tcp://127.0.0.1:9"
    assert main([*command[:2], "--out", str(tmp_path / "none"), *scheduler]) == 6
    assert "no Dask scheduler answers at" in capsys.readouterr().err.splitlines()[-1]
    monkeypatch.setitem(sys.modules, "distributed", None)
    assert main([*command, *scheduler]) == 2
    told = "yawid: --scheduler needs Dask: pip install 'yawid[fleet]'\n"
    assert capsys.readouterr().err == told
    assert not (tmp_path / "data").exists()

    (tmp_path / "python").touch(0o644)
    monkeypatch.setattr(sys, "executable", str(tmp_path / "python"))
    warm.cache_clear()
    assert main(command) == 6
    assert "Permission denied" in capsys.readouterr().err.splitlines()[-1]


def test_another_fleet_s_data_set_is_neither_written_to_nor_read(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["fleet", str(REPLAY_LOGS / "no_rudder"), "--out", str(tmp_path / "data")]
    with DataSet(tmp_path / "data"):
        for dry in ([], ["--dry-run"]):
            assert main([*command, *dry]) == 6
            assert "another yawid fleet is writing to" in capsys.readouterr().err


def _wait_for_logs(out: Path, count: int) -> None:
    """Wait until a running fleet, which locks its database, has so many finished logs."""

    def found() -> bool:
        with suppress(sqlite3.Error), closing(sqlite3.connect(name, uri=True)) as database:
            [(finished,)] = database.execute("SELECT count(*) FROM rows WHERE name = 'logs'")
            return finished >= count
        return False  # it is being written

    name = f"{(out / DATABASE).as_uri()}?immutable=1"
    wait_until(found)


MANY, TIMEOUT_S, BETWEEN_S, MOST_S = 200, 5.0, 15.0, 600.0
KINDS = {"killer": ("crashed", 3), "stops": ("timeout", 2), "hangs": ("timeout", 2)}
"""The outcome of each kind of bad log, and how many there are of it."""


def cut_logs(folder: Path) -> None:
    """Cut short logs from those of the project; no two are alike."""
    folder.mkdir()
    whole = [path.read_bytes() for path in sorted(REPLAY_LOGS.glob("*/log.tlog"))]
    names = [f"{kind}{i}" for kind, (_, n) in KINDS.items() for i in range(n)]
    names += [f"log{i:03d}" for i in range(MANY - len(names))]
    for i, name in enumerate(names):
        data = whole[i % len(whole)]
        (folder / f"{name}.tlog").write_bytes(data[: 30_000 + 1_000 * (i // len(whole))])


def replaying(fleet: psutil.Process) -> Iterator[psutil.Process]:
    for each in fleet.children(recursive=True):
        try:
            if "yawid.fleet.one_log" in each.cmdline():
                yield each
        except psutil.Error:
            continue


@pytest.mark.long
@pytest.mark.skipif(sys.platform == "win32", reason="no such signals there")
def test_each_log_has_one_outcome_whatever_happens_to_the_processes(tmp_path: Path) -> None:
    logs, out, drawn = tmp_path / "logs", tmp_path / "data", random.Random(5)
    cut_logs(logs)
    env = environment(tmp_path / "hook")
    words = (logs, "--workers", "2", "--timeout", f"{TIMEOUT_S:g}", "--out")
    hurt, below = Counter[int](), set[psutil.Process]()
    with yawid_fleet(env, *words, out, within_s=MOST_S) as run:
        fleet, next_s = psutil.Process(run.pid), time.monotonic() + 3.0
        while run.poll() is None:
            time.sleep(0.05)
            below |= (now := set(replaying(fleet)))
            if now and time.monotonic() > next_s:  # seldom, so that no log is hurt three times
                next_s = time.monotonic() + BETWEEN_S
                number = [signal.SIGKILL, signal.SIGSTOP][hurt.total() % 2]
                os.kill(drawn.choice(sorted(each.pid for each in now)), number)
                hurt[number] += 1
        said = run.communicate(timeout=MOST_S)
    assert run.returncode == 0, said
    assert [each for each in below if each.is_running()] == []
    assert min(hurt[signal.SIGKILL], hurt[signal.SIGSTOP]) >= 1

    rows = tables(out)["logs"]
    assert sorted(str(row["path"]) for row in rows) == sorted(map(str, logs.iterdir()))
    outcomes = {Path(str(row["path"])).stem: row["outcome"] for row in rows}
    for kind, (outcome, count) in KINDS.items():
        assert [outcomes.pop(f"{kind}{i}") for i in range(count)] == [outcome] * count
    assert Counter(outcomes.values())["timeout"] <= hurt[signal.SIGSTOP]
    known = {f"{kind}{i}" for kind, (_, n) in KINDS.items() for i in range(n)}
    crashed = [row for row in rows if row["outcome"] == "crashed"]
    assert [row["text"] for row in crashed if Path(str(row["path"])).stem not in known] == []

    for path in logs.iterdir():
        if path.stem not in outcomes:
            path.unlink()
    with yawid_fleet(
        env, *words, out, "--retry", within_s=MOST_S
    ) as run:  # what was stopped, by its own merits
        said = run.communicate(timeout=MOST_S)
    assert run.returncode == 0, said
    with yawid_fleet(env, *words, tmp_path / "quiet", within_s=MOST_S) as run:
        said = run.communicate(timeout=MOST_S)
    assert run.returncode == 0, said
    again, quiet = (
        {row["path"]: row["outcome"] for row in tables(each)["logs"]}
        for each in (out, tmp_path / "quiet")
    )
    assert {path: again[path] for path in quiet} == quiet
    assert set(quiet.values()) <= {"ok", "unusable"}
