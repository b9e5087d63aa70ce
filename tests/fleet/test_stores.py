"""Data sets, logs and runs in a store of fsspec: in memory, in local files, on an S3 server."""

from __future__ import annotations

import importlib.util
import os
import platform
import re
import socket
import subprocess
import sys
import time
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from checks.children import child
from places import C172P, ROOT

import yawid
from yawid.cli.main import main
from yawid.dataset.files import merge, read_table
from yawid.dataset.places import read_manifest
from yawid.dataset.schema import TABLES
from yawid.errors import SinkError
from yawid.fleet.child import rows_here
from yawid.fleet.find_logs import find_logs
from yawid.fleet.hold import Hold
from yawid.fleet.journal import FINISHED, LOCK, Journal
from yawid.system.stores import StoredPath, brought, place_of

GCS = ROOT / "replay_logs" / "c172p_gcs_rates" / "log.tlog"
MAY, JUNE = 1_780_000_000_000_000, 1_782_000_000_000_000
MADE_BY = {"yawid_version": "0", "analysis_version": "1", "config_hash": "c"}


def entry(path: str, sha: str, date: int = MAY, **values: Any) -> Any:
    log = {"path": path, "log_sha256": sha, "outcome": "ok", **MADE_BY}
    keys = {"log_sha256": sha, "sysid": 1, "boot": 1, "vehicle": "sysid:1", **MADE_BY}
    return {"logs": [log], "flights": [{**keys, "date": date, **values}]}


@pytest.fixture(params=["memory", "file"])
def place(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch) -> StoredPath:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    if request.param == "file":
        return StoredPath(f"file://{tmp_path}/data")
    return StoredPath(f"memory://{uuid.uuid4().hex}/data")


def test_a_data_set_in_a_store_is_that_of_a_folder_and_a_part_written_one_is_as_before(
    place: StoredPath, tmp_path: Path, monkeypatch
):
    first = [entry("/a", "A", zeta=0.25), entry("/b", "B", JUNE)]
    second = [entry("/b", "B2", JUNE, zeta=0.5), entry("/c", "C")]
    for entries in (first, second):
        merge(place, entries)
        merge(tmp_path / "folder", entries)
    for name in TABLES:
        assert read_table(place, name).equals(read_table(tmp_path / "folder", name))
    assert read_manifest(place) == read_manifest(tmp_path / "folder")
    files = {path for path in (tmp_path / "folder").rglob("*") if path.is_file()}
    names = {path.relative_to(tmp_path / "folder").as_posix() for path in files}
    assert set(place.below()) == names

    before = read_table(place, "flights")
    with monkeypatch.context() as patched:
        written = StoredPath.write_bytes
        is_last = {"manifest.json"}

        def cut(path: StoredPath, data: bytes) -> None:
            if path.name in is_last:
                raise OSError(5, "the store went away")
            written(path, data)

        patched.setattr(StoredPath, "write_bytes", cut)
        with pytest.raises(SinkError, match=r"cannot write .*data: the store went away"):
            merge(place, [entry("/d", "D")])
    assert read_table(place, "flights").equals(before)
    merge(place, [entry("/d", "D")])
    assert len(read_table(place, "flights")) == len(before) + 1
    assert not [name for name in place.below() if name.startswith("_new/")]


def test_one_fleet_at_a_time_writes_there_and_a_killed_one_of_this_machine_is_followed(
    place: StoredPath, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    first = Journal(place)
    (tmp_path / "elsewhere").mkdir()
    with pytest.raises(SinkError, match=f"another yawid fleet .*{re.escape(platform.node())}"):
        Hold(place / LOCK, tmp_path / "elsewhere")
    first.add(entry("/a", "A"))
    [journal] = (tmp_path / "state").rglob(FINISHED)
    assert journal.read_bytes().endswith(b"\n")
    assert first._stream is not None
    first._stream.close()  # as a kill does: the journal and the lock in the store stay
    first._lock.close()
    capsys.readouterr()

    second = Journal(place)
    assert set(second.known()) == {"/a"}
    alone = "this store cannot refuse a second writer" in capsys.readouterr().err
    assert alone is str(place).startswith("file:")  # fsspec's local files look first, then write
    (place / LOCK).write_bytes(b"of somebody else")
    second.add(entry("/b", "B"))
    with pytest.raises(SinkError, match=r"\.lock was removed or replaced"):
        second.close()
    assert (place / LOCK).read_bytes() == b"of somebody else"
    (place / LOCK).unlink()
    third = Journal(place)
    third.close()
    assert set(read_table(place, "logs", ["path"])["path"].to_pylist()) == {"/a", "/b"}
    assert not (place / LOCK).exists()


def test_a_log_and_a_run_are_read_from_a_store_under_their_urls(
    tmp_path: Path, monkeypatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.chdir(tmp_path)
    there = StoredPath(f"memory://{uuid.uuid4().hex}")
    (there / "day.tlog").write_bytes(GCS.read_bytes())
    words = ["replay", str(there / "day.tlog"), "--manoeuvres", "off", "--json"]
    assert main(words) == 0
    assert f'"log": "{there}/day.tlog"' in capsys.readouterr().out
    (there / "run.mcap").write_bytes(Path("yawid-out/day.mcap").read_bytes())

    run = yawid.load(str(there / "run.mcap"))
    assert (run.summary.log, run.summary.verdict) == (f"{there}/day.tlog", None)
    assert str(run.path) == f"{there}/run.mcap"
    assert not yawid.diff(run, str(there / "run.mcap")).changed
    assert main(["replay", str(there / "nothing.tlog")]) == 6
    assert main(["trend", str(there / "data")]) == 6
    said = capsys.readouterr().err
    assert f"{there}/nothing.tlog cannot be read: No such file or directory" in said
    assert f"{there}/data is not a data set: it has no manifest.json" in said
    assert main(["replay", "nosuch://x/y"]) == 6
    assert "Protocol not known: nosuch" in capsys.readouterr().err
    if importlib.util.find_spec("s3fs") is None:
        assert main(["trend", "s3://bucket/data"]) == 2
        assert "yawid: s3://bucket/data/manifest.json: Install s3fs" in capsys.readouterr().err
    assert place_of(f"file://{tmp_path}") == tmp_path
    with brought(there / "day.tlog") as local:
        assert local.read_bytes() == GCS.read_bytes()
    assert not local.exists()


class InThisProcess:
    """Workers without processes of their own."""

    address, threads = "here", 1

    def run(self, tasks, stop):
        for task in tasks:
            yield task, rows_here(task.path, task.spec, Path(), None)


@pytest.fixture
def here(monkeypatch, tmp_path: Path) -> Path:
    @contextmanager
    def workers(count: int | None) -> Iterator[InThisProcess]:
        yield InThisProcess()

    monkeypatch.setattr("yawid.fleet.run_fleet.local_workers", workers)
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
    StoredPath(url).write_bytes(b"12345")

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
        "AWS_ENDPOINT_URL": f"http://127.0.0.1:{port}", "XDG_STATE_HOME": str(tmp_path),
    }  # fmt: skip
    for name in env.keys() - os.environ.keys():
        monkeypatch.setenv(name, env[name])
    server = [sys.executable, "-m", "moto.server", "-p", str(port)]
    quiet = subprocess.DEVNULL
    with child(server, within_s=600.0, env=env, stdout=quiet, stderr=quiet):
        import fsspec

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

        asked = ("fleet", "s3://flown/logs", "s3://flown/two.tlog", "--out", "s3://flown/data")
        code, said = run(*asked, "--workers", "1")
        assert (code, "logs 2" in said, "cannot refuse" in said) == (0, True, False), said
        assert "0 logs to run, 2 known already" in run(*asked)[1]
        assert run("trend", "s3://flown/data")[0] == 5  # too few days
        assert run("diff", "s3://flown/data", "s3://flown/data")[0] == 5  # too few days
        code, said = run("replay", "s3://flown/two.tlog", "--json")
        assert (code, '"log": "s3://flown/two.tlog"' in said) == (0, True)
        store.pipe("flown/run.mcap", (tmp_path / "yawid-out" / "two.mcap").read_bytes())
        assert yawid.load("s3://flown/run.mcap").usable
        assert (StoredPath("s3://flown/data") / "manifest.json").creates_once
        store.pipe("flown/data/.lock", b"elsewhere, process 3, since yesterday, abc")
        code, said = run(*asked)
        assert code == 6
        assert "another yawid fleet is writing there (elsewhere, process 3, since yest" in said
