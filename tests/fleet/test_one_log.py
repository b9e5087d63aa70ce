"""One log as rows: each outcome has its text; in a store of fsspec it is read by its URL."""

from __future__ import annotations

import errno
import importlib.util
import os
import socket
import subprocess
import sys
import time
import uuid
from collections.abc import Callable
from hashlib import sha256
from pathlib import Path, PureWindowsPath
from typing import Any

import fsspec
import pytest
from checks.children import child
from finished_runs import replayed
from live_link import wait_until
from places import C172P, REPLAY_LOGS, ROOT

import yawid
from yawid.cli.main import main
from yawid.config.run import RunConfig
from yawid.dataset.files import read_table, table_of
from yawid.dataset.schema import TABLES
from yawid.fleet.find_logs import find_logs
from yawid.fleet.one_log import Rows, rows_here, rows_of
from yawid.fleet.spec import Spec
from yawid.system.stores import brought, place_of


def log_of(case: str) -> Path:
    return REPLAY_LOGS / case / "log.tlog"


def fitting(rows: Rows) -> Rows:
    """Return rows after a look whether they fit the tables, each key once."""
    for name, each in rows.items():
        table_of(TABLES[name], each)
        keys = [tuple(row.get(key) for key in TABLES[name].keys) for row in each]
        assert len(set(keys)) == len(keys)
    return rows


@pytest.mark.parametrize(
    ("case", "whose"),
    [("two_vehicles", [(1, 1), (2, 1)]), ("c172p_reboot", [(1, 1), (1, 2)])],
)
def test_each_vehicle_and_each_boot_of_a_log_is_a_flight(
    case: str, whose: list[tuple[int, int]]
) -> None:
    rows = fitting(rows_of(log_of(case), Spec()))

    assert [(row["sysid"], row["boot"]) for row in rows["flights"]] == whose
    assert {(row["sysid"], row["boot"]) for row in rows["manoeuvres"]} == set(whose)
    assert len(rows["runs"]) == 2 * len(whose)
    assert rows["logs"][0]["flights"] == len(whose)
    assert all(row["usable"] for row in rows["flights"])


def test_what_was_asked_for_binds_every_log_and_seconds_are_kept_where_wanted() -> None:
    settings = {"boot": 2, "manoeuvres": "off", "orders": (2, 2, 2, 1)}
    rows = fitting(rows_of(log_of("c172p_reboot"), Spec(settings, modes=True)))

    (flight,) = rows["flights"]
    assert (flight["boot"], flight["answer"]) == (2, "stream")
    assert {row["na"] for row in rows["runs"]} == {2}
    assert flight["duration_s"] == pytest.approx(len(rows["modes"]), abs=2)
    assert rows["modes"][-1]["wn_rad_s"] == pytest.approx(flight["wn_rad_s"], rel=0.05)
    assert not rows["manoeuvres"]


def test_a_finished_run_gives_the_manoeuvres_of_its_log_under_the_logs_own_hash(
    tmp_path: Path,
) -> None:
    log = log_of("sitl_fbwa_manoeuvres")
    mcap = replayed(log, tmp_path)

    of_log, of_mcap = fitting(rows_of(log, Spec())), fitting(rows_of(mcap, Spec()))

    assert of_mcap["manoeuvres"] == of_log["manoeuvres"]
    assert of_mcap["logs"][0]["log_sha256"] == of_log["logs"][0]["log_sha256"]
    assert of_mcap["logs"][0]["file_sha256"] != of_log["logs"][0]["file_sha256"]
    assert of_log["logs"][0]["outcome"] == of_mcap["logs"][0]["outcome"] == "ok"


Told = Callable[[Path], Rows]
NO_RUDDER = log_of("no_rudder")


def written(path: Path, data: bytes) -> Path:
    path.write_bytes(data)
    return path


def keyed(path: Path, key: str, then: str | None) -> Rows:
    """Return the rows of a log whose key has changed, or is gone, since the fleet was started."""
    path.write_text(key, encoding="utf-8")
    spec = Spec(key_file=str(path))
    path.unlink()
    if then is not None:
        path.write_text(then, encoding="utf-8")
    return rows_of(NO_RUDDER, spec)


OUTCOMES: list[tuple[str, str, str, Told]] = [
    (
        "text", "unreadable", "text.tlog is a text file",
        lambda folder: rows_of(written(folder / "text.tlog", b"no log\n"), Spec()),
    ),
    ("no rudder", "unusable", "rudder", lambda _: rows_of(NO_RUDDER, Spec())),
    (
        "usage", "usage", "500",
        lambda _: rows_of(log_of("c172p_3211"), Spec({"rate": 500.0})),
    ),
    (
        "bug", "crashed", "ZeroDivisionError: division by zero (test_one_log.py:",
        lambda _: rows_of(NO_RUDDER, Spec()),
    ),
    (
        "full disk", "failed", "read: No space left on device",
        lambda folder: rows_here(f"file://{NO_RUDDER}", Spec(), folder),
    ),
    (
        "no pyulog", "failed", "needs pyulog (pip install 'yawid[ulog]')",
        lambda folder: rows_of(
            written(folder / "a.ulg", b"ULog\x01\x12\x35\x01" + bytes(8)), Spec()
        ),
    ),
    *(
        (
            "absent", "failed", "No such file or directory",
            lambda folder, url=url: rows_here(f"{url}{folder}/absent.tlog", Spec(), folder),
        )
        for url in ("", "file://")
    ),
    (
        "another key", "failed", "key: it holds another key than when the fleet was started",
        lambda folder: keyed(folder / "key", "one\n", "other\n"),
    ),
    (
        "no key", "failed", "key: No such file or directory",
        lambda folder: keyed(folder / "key", "one\n", None),
    ),
]  # fmt: skip


@pytest.mark.parametrize(("what", "outcome", "text", "rows"), OUTCOMES)
def test_whatever_is_wrong_is_an_outcome_and_what_the_machine_lacks_says_nothing_of_the_log(
    what: str, outcome: str, text: str, rows: Told, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    if what == "full disk":
        monkeypatch.setattr("shutil.copyfileobj", full)
    if what == "no pyulog":
        monkeypatch.setitem(sys.modules, "pyulog", None)
    if what == "bug":
        monkeypatch.setattr("yawid.fleet.one_log.open_log", lambda *_, **__: 1 / 0)
    [row] = fitting(rows(tmp_path))["logs"]
    reasons = ["no_rudder"] if what == "no rudder" else [outcome]
    assert (row["outcome"], row["reasons"]) == (outcome, reasons)
    assert text in row["text"]
    assert not [path for path in tmp_path.iterdir() if path.is_dir()]


def test_options_and_a_key_s_content_are_in_the_hash_and_not_how_they_are_given(
    tmp_path: Path,
) -> None:
    keys = {"a": "one\n", "b": "one", "c": sha256(b"one").hexdigest(), "d": "two\n"}
    of = {}
    for name, text in keys.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
        of[name] = Spec(key_file=str(tmp_path / name)).config_hash
    assert of["a"] == of["b"] == of["c"]
    whole = {name: getattr(RunConfig(), name) for name in ("method", "turn", "rate")}
    assert Spec(whole).config_hash == Spec().config_hash
    others = (Spec(), Spec({"turn": "remove"}), Spec(modes=True))
    assert len({of["a"], of["d"], *(each.config_hash for each in others)}) == 5


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
    with pytest.raises(SystemExit, match="2"):
        main(["trend", "s3://bucket/data"])
    assert "is a URL, but a path on this machine is needed" in capsys.readouterr().err
    assert place_of(f"file://{tmp_path}") == tmp_path
    with brought(place_of(f"{there}/day.tlog")) as local:
        assert local.read_bytes() == GCS.read_bytes()
    assert not local.exists()


def test_records_in_a_folder_are_found_by_their_options_and_wrong_usage_leaves_no_row(
    tmp_path: Path, monkeypatch, capsys: pytest.CaptureFixture[str]
):
    def fleet(*options: str) -> tuple[int, dict[str, str]]:
        code = main(
            ["fleet", "logs", "--out", "data", "--workers", "1", "--manoeuvres", "off", *options]
        )
        found = read_table(Path("data"), "logs", ["path", "outcome"]).to_pylist()
        return code, {Path(row["path"]).name: str(row["outcome"]) for row in found}

    monkeypatch.chdir(tmp_path)
    Path("logs").mkdir()
    rows = [f"{i / 20},{i % 40 // 20},{i % 7 / 100}" for i in range(400)]
    Path("logs/own.csv").write_text("\n".join(["t,rudder,r", "s,,rad/s", *rows]), encoding="utf-8")
    assert main(["fleet", "logs", "--out", "data"]) == 6
    assert "for CSV and Parquet give --rudder-unit or --columns" in capsys.readouterr().err
    Path("logs/a.tlog").write_text("no log\n", encoding="utf-8")
    for _ in range(2):  # the second time nothing is run, and nothing is better
        assert fleet() == (6, {"a.tlog": "unreadable"})
    Path("logs/day.tlog").write_bytes(GCS.read_bytes())
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


def test_a_store_s_log_is_known_by_its_url_and_a_copy_stays_in_its_folder_on_windows_too(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    logs, data = tmp_path / "logs", tmp_path / "data"
    logs.mkdir()
    (logs / "..\\..\\evil.tlog").write_bytes(b"no log\n")
    (logs / "a.tlog").write_bytes(C172P.read_bytes())
    fleet = ["fleet", f"file://{logs}", "--out", str(data), "--workers", "1"]
    assert main(fleet) == 0
    before = {path: path.stat().st_mtime_ns for path in data.rglob("*.*")}
    assert main(fleet) == 0
    assert before.items() <= {path: path.stat().st_mtime_ns for path in data.rglob("*.*")}.items()
    assert "0 logs to run, 2 known already" in capsys.readouterr().err
    evil, own = sorted(read_table(data, "logs").to_pylist(), key=lambda row: row["path"])
    assert (own["path"], own["outcome"]) == (f"file://{logs}/a.tlog", "ok")
    assert (evil["path"][-9:], evil["outcome"]) == ("evil.tlog", "unreadable")
    [copy] = [word.rstrip(":") for word in evil["text"].split() if "evil.tlog" in word]
    assert PureWindowsPath(copy).name == copy


@pytest.mark.skipif(sys.platform == "win32", reason="the system kills no children there")
def test_what_a_killed_fleet_leaves_of_its_copies_is_removed_by_the_next(tmp_path: Path) -> None:
    logs, data = tmp_path / "logs", tmp_path / "data"
    logs.mkdir()
    (logs / "a.tlog").write_bytes(C172P.read_bytes())
    fleet = ["fleet", f"file://{logs}", "--out", str(data), "--workers", "1"]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    with child([sys.executable, "-m", "yawid", *fleet], **quiet) as process:
        wait_until(lambda: [*data.rglob("*.tlog")], every_s=0.005)
        process.kill()
        process.wait(60.0)
    assert [*data.rglob("*.tlog")]

    assert main(fleet) == 0
    assert [each for each in data.iterdir() if each.is_dir()] == []
