"""Logs and runs in a store of fsspec: in memory, in local files, on an S3 server."""

from __future__ import annotations

import importlib.util
import os
import socket
import subprocess
import sys
import time
import uuid
from collections.abc import Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import fsspec
import pytest
from checks.children import child
from places import C172P, ROOT

import yawid
from yawid.cli.main import main
from yawid.dataset.files import read_table
from yawid.fleet.find_logs import find_logs
from yawid.fleet.one_log import rows_here
from yawid.fleet.worker import Task
from yawid.system.stores import brought, place_of

GCS = ROOT / "replay_logs" / "c172p_gcs_rates" / "log.tlog"


def test_a_log_and_a_run_are_read_from_a_store_under_their_urls(
    tmp_path: Path, monkeypatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.chdir(tmp_path)
    there = f"memory://{uuid.uuid4().hex}"
    store = fsspec.filesystem("memory")
    store.pipe(f"{there}/day.tlog", GCS.read_bytes())
    words = ["replay", f"{there}/day.tlog", "--manoeuvres", "off", "--json"]
    assert main(words) == 0
    assert f'"log": "{there}/day.tlog"' in capsys.readouterr().out
    store.pipe(f"{there}/run.mcap", Path("yawid-out/day.mcap").read_bytes())

    run = yawid.load(f"{there}/run.mcap")
    assert (run.summary.log, run.summary.verdict) == (f"{there}/day.tlog", None)
    assert str(run.path) == f"{there}/run.mcap"
    assert not yawid.diff(run, f"{there}/run.mcap").changed
    assert main(["replay", f"{there}/nothing.tlog"]) == 6
    said = capsys.readouterr().err
    assert f"{there}/nothing.tlog cannot be read: No such file or directory" in said
    assert main(["replay", "nosuch://x/y"]) == 6
    assert "Protocol not known: nosuch" in capsys.readouterr().err
    if importlib.util.find_spec("s3fs") is None:
        assert main(["replay", "s3://bucket/a.tlog"]) == 2
        assert "yawid: s3://bucket/a.tlog: Install s3fs" in capsys.readouterr().err
    with pytest.raises(SystemExit) as ended:
        main(["trend", "s3://bucket/data"])
    assert ended.value.code == 2
    assert "is a URL, but a path on this machine is needed" in capsys.readouterr().err
    assert place_of(f"file://{tmp_path}") == tmp_path
    with brought(place_of(f"{there}/day.tlog")) as local:
        assert local.read_bytes() == GCS.read_bytes()
    assert not local.exists()


class InThisProcess:
    """Workers without processes of their own."""

    address, threads = "here", 1

    def submit(self, task: Task) -> Future[Any]:
        future: Future[Any] = Future()
        future.set_result(rows_here(task.path, task.spec, Path()))
        return future

    def rows(self, future: Future[Any]) -> Any:
        return future.result(timeout=60.0)


@pytest.fixture
def here(monkeypatch, tmp_path: Path) -> Path:
    @contextmanager
    def workers(count: int | None, copies: Path) -> Iterator[InThisProcess]:
        yield InThisProcess()

    monkeypatch.setattr("yawid.fleet.run_fleet.workers_here", workers)
    monkeypatch.chdir(tmp_path)
    Path("logs").mkdir()
    return tmp_path


def fleet(*options: str) -> tuple[int, dict[str, str]]:
    code = main(["fleet", "logs", "--out", "data", "--manoeuvres", "off", *options])
    found = read_table(Path("data"), "logs", ["path", "outcome"]).to_pylist()
    return code, {Path(row["path"]).name: str(row["outcome"]) for row in found}


def test_records_in_a_folder_are_found_by_their_options_and_wrong_usage_leaves_no_row(
    here: Path, capsys: pytest.CaptureFixture[str]
):
    rows = [f"{i / 20},{i % 40 // 20},{i % 7 / 100}" for i in range(400)]
    Path("logs/own.csv").write_text("\n".join(["t,rudder,r", "s,,rad/s", *rows]), encoding="utf-8")
    assert main(["fleet", "logs", "--out", "data"]) == 6
    assert "for CSV and Parquet give --rudder-unit or --columns" in capsys.readouterr().err
    Path("logs/day.tlog").write_bytes(GCS.read_bytes())
    Path("logs/a.tlog").write_text("no log\n", encoding="utf-8")
    found = {"a.tlog": "unreadable", "day.tlog": "ok", "own.csv": "ok"}  # nothing is judged
    assert fleet("--rudder-unit", "rad", "--rudder-sign", "nose-right") == (0, found)
    assert fleet("--rate", "500") == (2, found)
    assert "1 logs were not run with these options; " in capsys.readouterr().err


def test_a_file_that_is_named_is_found_where_find_gives_a_list(monkeypatch):
    """As adlfs's find does of a file, whatever detail says."""
    from fsspec.implementations.memory import MemoryFileSystem

    found = MemoryFileSystem.find

    def as_azure(store: Any, path: str, *options: Any, **more: Any) -> Any:
        names = found(store, path, *options, **more)
        return list(names) if store.isfile(path) else names

    monkeypatch.setattr(MemoryFileSystem, "find", as_azure)
    url = f"memory:///{uuid.uuid4().hex}/two.tlog"
    fsspec.filesystem("memory").pipe(url, b"12345")

    [log] = find_logs([url])
    assert (log.path, log.size) == (url, 5)


def test_where_no_log_can_be_read_the_exit_code_is_6(here: Path):
    Path("logs/a.tlog").write_text("no log\n", encoding="utf-8")
    assert fleet() == (6, {"a.tlog": "unreadable"})
    assert fleet() == (6, {"a.tlog": "unreadable"})  # nothing was run, and nothing is better


@pytest.mark.long
def test_a_fleet_on_an_s3_server(tmp_path: Path, monkeypatch):
    """moto's server speaks S3 over HTTP, with conditional writes; s3fs is the client."""
    pytest.importorskip("s3fs")
    pytest.importorskip("moto")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    env = os.environ | {
        "AWS_ACCESS_KEY_ID": "x", "AWS_SECRET_ACCESS_KEY": "y", "AWS_DEFAULT_REGION": "us-east-1",
        "AWS_ENDPOINT_URL": f"http://127.0.0.1:{port}",
    }  # fmt: skip
    for name in env.keys() - os.environ.keys():
        monkeypatch.setenv(name, env[name])
    server = [sys.executable, "-m", "moto.server", "-p", str(port)]
    quiet = subprocess.DEVNULL
    with child(server, within_s=600.0, env=env, stdout=quiet, stderr=quiet):
        store = fsspec.filesystem("s3")
        for _ in range(100):
            try:
                store.mkdir("flown")
                break
            except Exception:  # it does not listen yet
                time.sleep(0.2)
        store.pipe({"flown/logs/one.tlog": GCS.read_bytes(), "flown/two.tlog": C172P.read_bytes()})

        def run(*words: str) -> tuple[int, str]:
            command = [sys.executable, "-m", "yawid", *words]
            done = subprocess.run(
                command, env=env, cwd=tmp_path, capture_output=True, text=True, timeout=300
            )
            assert "Traceback" not in done.stderr, done.stderr
            return done.returncode, done.stdout + done.stderr

        asked = ("fleet", "s3://flown/logs", "s3://flown/two.tlog", "--out", "data")
        code, said = run(*asked, "--workers", "1")
        assert (code, "logs 2" in said) == (0, True), said
        assert "0 logs to run, 2 known already" in run(*asked)[1]
        code, said = run("replay", "s3://flown/two.tlog", "--json")
        assert (code, '"log": "s3://flown/two.tlog"' in said) == (0, True)
        store.pipe("flown/run.mcap", (tmp_path / "yawid-out" / "two.mcap").read_bytes())
        assert yawid.load("s3://flown/run.mcap").usable
