"""``yawid fleet --vehicle NAME`` and ``--vehicle-from folder``: whose flight each log is."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from places import REPLAY_LOGS

from yawid.cli.main import main

LOGS = {"falcon": "c172p_gcs_rates", "heron": "no_rudder", "pair": "two_vehicles"}
"""One log in each folder; in the last one two vehicles fly."""
OF_VEHICLES = ("flights", "flights_by_loop", "manoeuvres", "runs")


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("logs")
    for name, case in LOGS.items():
        (folder / name).mkdir()
        shutil.copy(REPLAY_LOGS / case / "log.tlog", folder / name / "log.tlog")
    return folder


@pytest.fixture(scope="module")
def named(logs: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    data = tmp_path_factory.mktemp("data") / "named"
    argv = ["fleet", str(logs), "--out", str(data), "--vehicle-from", "folder", "--workers", "1"]
    assert main(argv) == 0
    return data


def vehicles(data: Path, table: str) -> set[str]:
    return set(pq.read_table(data / f"{table}.parquet", columns=["vehicle"])["vehicle"].to_pylist())


def test_the_folder_names_the_aircraft_in_every_table_and_in_trend(
    named: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    both = {"pair sysid:1", "pair sysid:2"}
    assert vehicles(named, "flights") == {"falcon", "heron"} | both
    for table in OF_VEHICLES:
        assert {"falcon"} < vehicles(named, table) <= {"falcon", "heron"} | both

    assert main(["trend", str(named), "--vehicle", "falcon", "--json"]) == 5
    said = json.loads(capsys.readouterr().out)
    assert {each["vehicle"] for each in said["followed"]} == {"falcon"}
    assert said["warnings"] == []


def test_a_log_that_is_named_otherwise_is_run_again_and_else_it_is_known(
    logs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    argv = ["fleet", str(logs / "heron"), "--out", str(tmp_path / "data"), "--workers", "1"]
    assert main(argv) == 0
    assert vehicles(tmp_path / "data", "flights") == {"sysid:1"}
    name = [*argv, "--vehicle", "Grey heron"]

    assert main(name) == 0
    assert vehicles(tmp_path / "data", "flights") == {"Grey heron"}
    capsys.readouterr()
    assert main([*name, "--dry-run"]) == 0
    assert "to run: 0 logs" in capsys.readouterr().out
    # The same in a file; the folder's name does not depend on the path that was searched.
    toml = tmp_path / "fleet.toml"
    toml.write_text('vehicle-from = "folder"\n', encoding="utf-8")
    log = str(logs / "heron" / "log.tlog")
    assert main(["fleet", log, *argv[2:], "--config", str(toml)]) == 0
    assert vehicles(tmp_path / "data", "flights") == {"heron"}


@pytest.mark.parametrize(
    ("given", "says"),
    [
        (
            ["--vehicle", "a", "--vehicle-from", "folder"],
            "give --vehicle or --vehicle-from, not both",
        ),
        (["--vehicle", "  "], "--vehicle must be a name that can be printed, got"),
        (["--vehicle", "a\x1b[2J"], "--vehicle must be a name"),
        (["--vehicle-from", "file"], "must be one of folder, got 'file'"),
        (["--config", "two.toml"], "give --vehicle or --vehicle-from, not both"),
        (["--config", "file.toml"], "--vehicle-from: must be one of folder, got 'file'"),
    ],
)
def test_a_name_that_cannot_be_is_one_line_and_2(
    logs: Path, tmp_path: Path, monkeypatch, capsys, given: list[str], says: str
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("two.toml").write_text('vehicle = "a"\nvehicle-from = "folder"\n', encoding="utf-8")
    Path("file.toml").write_text('vehicle-from = "file"\n', encoding="utf-8")
    try:
        code = main(["fleet", str(logs), "--out", "data", *given])
    except SystemExit as error:
        code = error.code
    (line,) = capsys.readouterr().err.splitlines()
    assert (code, says in line) == (2, True), line
