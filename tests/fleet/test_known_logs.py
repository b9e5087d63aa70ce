"""Which logs a fleet runs, whose they are, where their rows may go, and the time that is left."""

from __future__ import annotations

import heapq
import json
import shutil
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest
from data_sets import MAY, entry, merge
from places import REPLAY_LOGS

from yawid.cli.main import main
from yawid.dataset.files import read_table
from yawid.dataset.schema import ANALYSIS_VERSION
from yawid.fleet.find_logs import FoundLog
from yawid.fleet.run_fleet import FleetRun, Progress, plan_of
from yawid.fleet.spec import Spec


@pytest.mark.parametrize(
    ("other", "to_run"),
    [
        ({}, 0),
        ({"analysis_version": f"{ANALYSIS_VERSION}0"}, 1),
        ({"config_hash": "another"}, 1),
        ({"size_bytes": 1}, 1),
        ({"modified": "1"}, 1),
        ({"outcome": "failed"}, 1),
        ({"outcome": "timeout"}, 0),
    ],
)
def test_a_log_is_known_where_all_that_its_numbers_depend_on_is_the_same(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], other: dict[str, Any], to_run: int
) -> None:
    log = tmp_path / "logs" / "a.tlog"
    log.parent.mkdir()
    shutil.copy(REPLAY_LOGS / "no_rudder" / "log.tlog", log)
    row = {
        "path": str(log),
        "size_bytes": log.stat().st_size,
        "modified": str(log.stat().st_mtime_ns),
        "config_hash": Spec().config_hash,
        "analysis_version": ANALYSIS_VERSION,
        "outcome": "ok",
    }
    merge(tmp_path / "data", [{"logs": [row | other]}])

    assert main(["fleet", str(log.parent), "--out", str(tmp_path / "data"), "--dry-run"]) == 0
    assert capsys.readouterr().out.startswith(f"to run: {to_run} logs,")


LOGS = {"falcon": "c172p_gcs_rates", "heron": "no_rudder", "pair": "two_vehicles"}
"""One log in each folder; in the last one two vehicles fly."""
OF_VEHICLES = ("flights", "flights_by_loop", "manoeuvres", "runs")


@pytest.fixture(scope="module")
def named_logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("logs")
    for name, case in LOGS.items():
        (folder / name).mkdir()
        shutil.copy(REPLAY_LOGS / case / "log.tlog", folder / name / "log.tlog")
    return folder


def vehicles(data: Path, table: str) -> set[str]:
    return set(pq.read_table(data / f"{table}.parquet", columns=["vehicle"])["vehicle"].to_pylist())


def test_the_folder_names_the_aircraft_in_every_table_and_in_trend(
    named_logs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    named = tmp_path / "named"
    argv = [
        "fleet",
        str(named_logs),
        "--out",
        str(named),
        "--vehicle-from",
        "folder",
        "--workers",
        "1",
    ]
    assert main(argv) == 0
    capsys.readouterr()
    both = {"pair sysid:1", "pair sysid:2"}
    assert vehicles(named, "flights") == {"falcon", "heron"} | both
    for table in OF_VEHICLES:
        assert {"falcon"} < vehicles(named, table) <= {"falcon", "heron"} | both

    assert main(["trend", str(named), "--vehicle", "falcon", "--json"]) == 5
    said = json.loads(capsys.readouterr().out)
    assert {each["vehicle"] for each in said["followed"]} == {"falcon"}
    assert said["warnings"] == []


def test_a_log_that_is_named_otherwise_is_run_again_and_else_it_is_known(
    named_logs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    argv = ["fleet", str(named_logs / "heron"), "--out", str(tmp_path / "data"), "--workers", "1"]
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
    log = str(named_logs / "heron" / "log.tlog")
    assert main(["fleet", log, *argv[2:], "--config", str(toml)]) == 0
    assert vehicles(tmp_path / "data", "flights") == {"heron"}


def test_what_lies_in_a_data_set_and_is_not_its_own_stays(tmp_path: Path) -> None:
    merge(tmp_path, [entry("/a", "A", MAY)])
    names = ("mine.parquet", "flights.parquet.bak", "flights/part-000001-0.parquet", "run.part")
    for name in names:
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("mine", encoding="utf-8")
    left = tmp_path / "flights.parquet.part"
    left.write_text("left by a run that was killed", encoding="utf-8")

    merge(tmp_path, [entry("/b", "B", MAY)])

    assert {(tmp_path / name).read_text(encoding="utf-8") for name in names} == {"mine"}
    assert not left.exists()
    assert read_table(tmp_path, "flights")["log_sha256"].to_pylist() == ["A", "B"]


COSTS = (
    (45225, 0.02),
    (103425, 0.38),
    (156354, 0.88),
    (200205, 0.5),
    (200205, 0.53),
    (200205, 0.52),
    (200205, 0.49),
    (200571, 0.49),
    (202922, 0.5),
    (204210, 0.51),
    (222345, 0.46),
    (223290, 1.34),
    (265998, 0.5),
    (399510, 0.45),
    (400410, 0.99),
    (506625, 0.53),
    (555533, 0.86),
    (601586, 0.8),
    (736184, 0.37),
    (794450, 0.8),
    (913545, 2.11),
)
"""Size in bytes and CPU time in s of each log of replay_logs, with default options."""
LONG = [(mb * 1_000_000, 0.3 + 0.99 * mb) for mb in range(10, 60)]


@pytest.mark.parametrize("more", [[], LONG])
def test_after_a_tenth_of_the_logs_the_time_left_is_known_within_a_factor_of_one_and_a_half(
    more: list[tuple[int, float]],
):
    costs = dict(enumerate([*COSTS * 20, *more]))
    logs = [FoundLog(f"{i}.tlog", size, "0") for i, (size, _) in costs.items()]
    logs.sort(key=lambda log: -log.size)  # as they are found
    todo = plan_of(FleetRun(paths=[], out=Path()), logs, {}).todo
    assert {log.path for log in todo} == {log.path for log in logs}

    free, ends = [0.0, 0.0], []
    for log in todo:
        end = heapq.heappop(free) + costs[int(log.path[:-5])][1]
        heapq.heappush(free, end)
        ends.append((end, log.size))
    ends.sort()
    progress, last = Progress(logs), ends[-1][0]
    for i, (passed_s, size) in enumerate(ends, 1):
        progress.add("ok", size)
        if i >= len(logs) / 10 and last - passed_s > last / 20:
            assert 1 / 1.5 < progress.left_s(passed_s) / (last - passed_s) < 1.5
