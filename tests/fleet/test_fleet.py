"""The whole way through ``yawid fleet`` with real processes, real workers and real deaths."""

from __future__ import annotations

import os
import shutil
import signal
import sqlite3
import sys
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import closing, suppress
from pathlib import Path

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
from places import REPLAY_LOGS

import yawid.fleet.pools
from yawid.cli.main import main
from yawid.dataset.files import DATABASE, DataSet, peek, read_table

COUNT = 16
NO_DISK = "/proc/self/mem"
"""Reading its first byte is an input/output error, as of a broken disk."""


@pytest.fixture(scope="session")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("fleet")


@pytest.fixture(scope="session")
def logs(place: Path) -> Path:
    """A few dozen logs: flights, two vehicles in one, one without a rudder, a copy, a text."""
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


def test_a_cluster_gives_the_rows_of_one_process(
    place: Path, logs: Path, reference: Path, running: Cluster, capsys: pytest.CaptureFixture[str]
) -> None:
    out = place / "by_cluster"

    assert main(["fleet", str(logs), "--out", str(out), "--scheduler", running.address]) == 0

    assert f"{out}: logs {COUNT + 4}, flights {COUNT + 3}" in capsys.readouterr().out
    assert tables(out) == tables(reference)


def test_a_log_that_kills_stops_or_hangs_its_process_has_one_row_and_its_neighbours_have_theirs(
    place: Path, logs: Path, running: Cluster, capsys: pytest.CaptureFixture[str]
) -> None:
    bad, out = place / "bad", place / "by_bad"
    bad.mkdir()
    for name in ("killer", "hangs", "stops", "good", "next"):
        shutil.copy(logs / "00.tlog", bad / f"{name}.tlog")
    command = ["fleet", str(bad), "--out", str(out), "--scheduler", running.address]

    assert main([*command, "--timeout", "3"]) == 0

    rows = {Path(str(row["path"])).stem: row for row in tables(out)["logs"]}
    good = rows["good"]["outcome"]
    outcomes = {name: row["outcome"] for name, row in rows.items()}
    assert outcomes == {
        "good": good, "hangs": "timeout", "killer": "crashed", "next": good, "stops": "timeout",
    }  # fmt: skip
    assert good in ("ok", "unusable")
    assert rows["killer"]["reasons"] == ["crashed"]
    assert rows["killer"]["text"] == "its process was killed by SIGSEGV, 3 times"
    assert (
        rows["hangs"]["text"]
        == rows["stops"]["text"]
        == "it did not finish within 3 s: allow more with --timeout"
    )
    capsys.readouterr()
    assert main([*command, "--dry-run"]) == main([*command, "--dry-run", "--retry"]) == 0
    told = capsys.readouterr().out.splitlines()
    assert [line.split(",")[0] for line in told] == ["to run: 0 logs", "to run: 3 logs"]


def test_what_is_known_is_not_run_again_unless_it_changed_or_is_to_be_retried(
    place: Path, reference: Path, logs: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def to_run(*options: str) -> str:
        assert main(["fleet", str(logs), "--out", str(out), "--dry-run", *options]) == 0
        return capsys.readouterr().out

    out = place / "known"
    shutil.copytree(reference, out)
    before = {path: path.stat().st_mtime_ns for path in out.rglob("*.*")}

    assert to_run() == f"to run: 0 logs, 0.0 MB; known already: {COUNT + 4}\n"
    assert "to run: 0 logs" in to_run("--retry")
    assert f"to run: {COUNT + 4} logs" in to_run("--orders", "2,2,2,1")
    assert main(["fleet", str(logs), "--out", str(out)]) == 0
    assert before.items() <= {path: path.stat().st_mtime_ns for path in out.rglob("*.*")}.items()
    times = {name: (logs / name).stat().st_mtime_ns for name in ("05.tlog", "text.tlog")}
    try:
        for name in times:
            (logs / name).touch()
        assert "to run: 2 logs" in to_run()
    finally:
        for name, time_ns in times.items():
            os.utime(logs / name, ns=(time_ns, time_ns))


def test_a_fleet_that_is_killed_goes_on_where_it_was_and_ends_with_the_same_data_set(
    place: Path,
    logs: Path,
    reference: Path,
    env: dict[str, str],
    running: Cluster,
    capsys: pytest.CaptureFixture[str],
) -> None:
    out = place / "killed"
    with yawid_fleet(env, logs, "--out", out, "--workers", "2") as run:
        _wait_for_logs(out, 5)
        run.kill()
        run.communicate(timeout=60)
    done = len(peek(out))
    assert done >= 4  # the fifth may have been seen before its transaction ended

    assert main(["fleet", str(logs), "--out", str(out), "--scheduler", running.address]) == 0

    told = f"{COUNT + 4 - done} logs to run, {done} known already"
    assert told in capsys.readouterr().err
    assert tables(out) == tables(reference)


def test_ctrl_c_keeps_what_is_finished(place: Path, logs: Path, env: dict[str, str]) -> None:
    out = place / "interrupted"
    with yawid_fleet(env, logs, "--out", out, "--workers", "1") as run:
        _wait_for_logs(out, 3)
        os.killpg(run.pid, signal.SIGINT)  # as a terminal does
        said = run.communicate(timeout=60)

    assert run.returncode == 130, said
    kept = len(read_table(out, "logs"))
    assert 3 <= kept < COUNT + 4
    told = f"SIGINT: {kept} logs are finished and saved, {COUNT + 4 - kept} were not reached"
    assert said[1].splitlines()[-1] == f"yawid: {told}"
    assert "Traceback" not in said[1]


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


def test_logs_of_a_store_are_known_by_their_url(
    place: Path, logs: Path, running: Cluster, capsys: pytest.CaptureFixture[str]
) -> None:
    flights, out = place / "flights", place / "of_a_store"
    flights.mkdir()
    shutil.copy(logs / "00.tlog", flights / "a.tlog")
    command = ["fleet", f"file://{flights}", "--out", str(out), "--scheduler", running.address]

    assert main(command) == 0
    assert main(command) == 0

    assert "0 logs to run, 1 known already" in capsys.readouterr().err
    assert read_table(out, "logs", ["path", "outcome"]).to_pylist() == [
        {"path": f"file://{flights}/a.tlog", "outcome": "ok"}
    ]


def test_a_log_that_failed_for_a_reason_that_may_pass_is_told_and_tried_again_by_the_next_run(
    place: Path, logs: Path, running: Cluster, capsys: pytest.CaptureFixture[str]
) -> None:
    some, out = place / "some", place / "by_some"
    some.mkdir()
    shutil.copy(logs / "01.tlog", some / "good.tlog")
    (some / "broken.tlog").symlink_to(NO_DISK)
    command = ["fleet", str(some), "--out", str(out), "--scheduler", running.address]

    assert main(command) == 6
    told = capsys.readouterr().err.splitlines()[-1]
    assert told.startswith("yawid: 1 logs failed for a reason that may pass: repeat the command")
    assert f"{some}/broken.tlog: broken.tlog cannot be read (Input/output error)" in told
    rows = {Path(str(row["path"])).stem: row for row in tables(out)["logs"]}
    assert (rows["broken"]["outcome"], rows["broken"]["reasons"]) == ("failed", ["failed"])
    assert main([*command, "--dry-run"]) == 0
    assert capsys.readouterr().out.startswith("to run: 1 logs")

    whole = tables(out)
    (some / "good.tlog").unlink()
    (some / "good.tlog").symlink_to(NO_DISK)
    assert main(command) == 6
    assert "yawid: 2 logs failed" in capsys.readouterr().err
    after = tables(out)  # takes no earlier answer away
    assert after["flights"] == whole["flights"]
    assert [row["outcome"] for row in after["logs"]] == ["failed", rows["good"]["outcome"]]


@pytest.mark.parametrize(
    ("arguments", "code", "text"),
    [
        (["nowhere"], 6, "nowhere: no such file or folder"),
        (["."], 6, ".: no log was found there; the names of logs end in .tlog, .bin, .ulg, .mcap"),
        (["a.tlog", "--workers", "0"], 2, "--workers: must be a whole number from 1, got '0'"),
        (["a.tlog", "--scheduler", "nonsense"], 2, "--scheduler: must be an address, tcp://HOST:"),
        (["a.tlog", "--scheduler", "tcp://127.0.0.1:9"], 6, "no Dask scheduler answers at"),
    ],
)
def test_what_cannot_be_done_is_said_in_one_line(
    arguments: list[str],
    code: int,
    text: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(yawid.fleet.pools, "CONNECT_S", 0.5)
    if arguments[0] == "a.tlog":
        Path("a.tlog").write_bytes(b"x")
    try:
        ended: object = main(["fleet", *arguments, "--out", "../data"])
    except SystemExit as by_parser:
        ended = by_parser.code
    assert ended == code
    assert text in capsys.readouterr().err.splitlines()[-1]


def test_without_dask_one_line_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    out = tmp_path / "data"

    command = ["fleet", str(REPLAY_LOGS / "no_rudder"), "--out", str(out)]

    assert main([*command, "--scheduler", "tcp://127.0.0.1:9"]) == 2
    told = "yawid: --scheduler needs Dask: pip install 'yawid[fleet]'\n"
    assert capsys.readouterr().err == told
    assert not out.exists()


def test_another_folder_or_another_fleet_is_not_written_to(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["fleet", str(REPLAY_LOGS / "no_rudder"), "--out"]
    (tmp_path / "theirs").mkdir()
    (tmp_path / "theirs" / "notes.txt").write_text("mine", encoding="utf-8")
    assert main([*command, str(tmp_path / "theirs")]) == 6
    assert "is not empty and is not a data set" in capsys.readouterr().err
    with DataSet(tmp_path / "data"):
        for dry in ([], ["--dry-run"]):
            assert main([*command, str(tmp_path / "data"), *dry]) == 6
            assert "another yawid fleet is writing to" in capsys.readouterr().err
    with pytest.raises(SystemExit) as ended:
        main([*command, "s3://bucket/data"])
    assert ended.value.code == 2
    assert "is a URL, but a path on this machine is needed" in capsys.readouterr().err


def _wait_for_logs(out: Path, count: int) -> None:
    """Wait until a running fleet, which locks its database, has so many finished logs."""
    end_s, found = time.monotonic() + 60.0, 0
    while found < count:
        assert time.monotonic() < end_s
        time.sleep(0.02)
        with suppress(sqlite3.Error):  # read while it is written
            database = sqlite3.connect(f"{(out / DATABASE).as_uri()}?immutable=1", uri=True)
            with closing(database):
                select = "SELECT count(*) FROM rows WHERE name = 'logs'"
                (found,) = database.execute(select).fetchone()
