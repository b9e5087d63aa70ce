from __future__ import annotations

import datetime
import json
import math
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.dataset
import pytest

from yawid.dataset import files as dataset
from yawid.dataset.files import (
    MANIFEST,
    PAGE,
    SCHEMA,
    merge,
    read_flights_by_loop,
    read_manifest,
    read_table,
)
from yawid.dataset.schema import TABLES
from yawid.errors import SourceError

MADE_BY = {"yawid_version": "0", "analysis_version": "1", "config_hash": "c"}
MAY = 1_780_000_000_000_000  # 2026-05-28


def entry(path: str, sha: str | None, date: int | None = MAY, **values: Any) -> Any:
    log = {"path": path, "log_sha256": sha, "outcome": "ok" if sha else "crashed", **MADE_BY}
    keys = {"log_sha256": sha, "sysid": 1, "boot": 1, "vehicle": "sysid:1", **MADE_BY}
    return {"logs": [log], "flights": [{**keys, "date": date, **values}] if sha else []}


def test_a_data_set_reads_back_with_its_types_by_our_reader_and_as_plain_parquet(
    tmp_path: Path,
) -> None:
    merge(tmp_path, [entry("/b", "B", zeta=math.nan, used=[1, 2]), entry("/a", "A", zeta=0.25)])

    flights = read_table(tmp_path, "flights")
    assert flights.schema.equals(TABLES["flights"].schema)
    assert flights["zeta"].to_pylist() == [0.25, None]
    assert flights["used"].to_pylist() == [None, [1, 2]]
    assert flights["date"][0].as_py() == datetime.datetime(
        2026, 5, 28, 20, 26, 40, tzinfo=datetime.UTC
    )
    plain = pyarrow.dataset.dataset(tmp_path / "flights", partitioning="hive").to_table()
    assert plain["month"].to_pylist() == ["2026-05"] * 2
    assert plain.drop_columns("month").equals(flights)


def test_where_an_older_analysis_has_no_rows_by_loop_its_flights_stand_in(tmp_path: Path) -> None:
    old, new = entry("/a", "A", loop="airframe"), entry("/b", "B", loop="with_roll_loop")
    other = new["flights"][0] | {"loop": "airframe"}
    columns = ["log_sha256", "loop"]

    merge(tmp_path, [old])
    older = read_flights_by_loop(tmp_path, columns).to_pylist()
    assert older == [{"log_sha256": "A", "loop": "airframe"}]
    merge(tmp_path, [new | {"flights_by_loop": [*new["flights"], other]}])
    assert read_flights_by_loop(tmp_path, columns).to_pylist() == [
        {"log_sha256": "B", "loop": "airframe"},
        {"log_sha256": "B", "loop": "with_roll_loop"},
        *older,
    ]
    assert len(read_table(tmp_path, "flights")) == 2


def test_the_newest_outcome_of_a_log_replaces_the_older_one_with_all_its_rows(
    tmp_path: Path,
) -> None:
    merge(tmp_path, [entry("/a", "A"), entry("/b", "B"), entry("/c", "C", date=None)])
    merge(tmp_path, [entry("/a", "A2", date=None), entry("/b", None)])

    assert read_table(tmp_path, "logs", ["path", "log_sha256"]).to_pylist() == [
        {"path": "/a", "log_sha256": "A2"},
        {"path": "/b", "log_sha256": None},
        {"path": "/c", "log_sha256": "C"},
    ]
    assert read_table(tmp_path, "flights")["log_sha256"].to_pylist() == ["A2", "C"]
    assert read_manifest(tmp_path)["outcomes"] == {"ok": 2, "crashed": 1}
    assert sorted(path.name for path in (tmp_path / "flights").iterdir()) == ["month=unknown"]


def test_logs_of_the_same_bytes_have_their_flight_once(tmp_path: Path) -> None:
    merge(tmp_path, [entry("/a", "A"), entry("/copy/a", "A")])
    merge(tmp_path, [entry("/other/a", "A")])
    merge(tmp_path, [entry("/a", None)])

    assert read_table(tmp_path, "flights")["log_sha256"].to_pylist() == ["A"]
    assert read_manifest(tmp_path)["tables"]["logs"]["rows"] == 3


def test_of_a_log_and_its_mcap_the_log_tells_whichever_was_run_first(tmp_path: Path) -> None:
    log, mcap = entry("/b.tlog", "A", zeta=0.25), entry("/a.mcap", "A", zeta=0.5)
    log["logs"][0]["kind"], mcap["logs"][0]["kind"] = "tlog", "mcap"
    for name, order in (
        ("one", [[log], [mcap]]),
        ("other", [[mcap], [log]]),
        ("once", [[mcap, log]]),
    ):
        for entries in order:
            merge(tmp_path / name, entries)
        assert read_table(tmp_path / name, "flights")["zeta"].to_pylist() == [0.25]


def test_a_merge_that_is_killed_leaves_the_data_set_as_it_was_and_the_next_one_sweeps(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    merge(tmp_path, [entry("/a", "A")])

    def killed(files: object, *, force: bool) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(dataset, "write_whole", killed)
        with pytest.raises(KeyboardInterrupt):
            merge(tmp_path, [entry("/a", "A2"), entry("/b", "B")])

    assert read_table(tmp_path, "flights")["log_sha256"].to_pylist() == ["A"]
    merge(tmp_path, [entry("/b", "B")])
    files = read_manifest(tmp_path)["tables"]["flights"]["files"]
    on_disk = sorted(tmp_path.glob("flights/*/*"))
    assert [tmp_path / file["path"] for file in files] == on_disk
    assert read_table(tmp_path, "flights")["log_sha256"].to_pylist() == ["A", "B"]


def test_full_files_are_left_alone_and_big_months_are_cut(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(dataset, "MOST_ROWS", 4)
    merge(tmp_path, [entry(f"/{i}", f"{i}") for i in range(6)])
    first = read_manifest(tmp_path)["tables"]["flights"]["files"]
    merge(tmp_path, [entry("/6", "6")])

    second = read_manifest(tmp_path)["tables"]["flights"]["files"]
    assert [file["rows"] for file in first] == [4, 2]
    assert second[0] == first[0]
    assert sum(file["rows"] for file in second) == 7


def test_what_is_no_data_set_or_of_another_format_is_refused_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(SourceError, match=r"is not a data set: it has no manifest\.json"):
        read_table(tmp_path, "logs")
    (tmp_path / MANIFEST).write_text(json.dumps({"format": 99}), encoding="utf-8")
    with pytest.raises(SourceError, match="has format 99, this version reads 1"):
        read_table(tmp_path, "logs")


def test_a_data_set_holds_its_schema_which_names_every_column(tmp_path: Path) -> None:
    merge(tmp_path, [entry("/a", "A")])
    page = (tmp_path / PAGE).read_text(encoding="utf-8")
    definitions = json.loads((tmp_path / SCHEMA).read_text(encoding="utf-8"))["$defs"]
    for table in TABLES.values():
        names = table.schema.names
        assert len(set(names)) == len(names)
        assert set(table.keys) | set(table.order) <= set(names)
        assert list(definitions[table.name]["properties"]) == names
        assert all(f"\n| {name} |" in page for name in names)
        assert not any(pa.types.is_float32(kind) for kind in table.schema.types)
