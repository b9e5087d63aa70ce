from __future__ import annotations

import datetime
import math
import sqlite3
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from data_sets import MAY, entry, merge

from yawid.dataset import files as dataset
from yawid.dataset.files import DATABASE, PAGE, DataSet, read_table
from yawid.dataset.schema import TABLES, json_schema
from yawid.errors import SinkError, SourceError


def test_a_data_set_reads_back_with_its_types_by_our_reader_and_as_plain_parquet(
    tmp_path: Path,
) -> None:
    rows = [
        entry("/b", "B", MAY, zeta=math.nan, used=[1, 2]),
        entry("/a", "A", MAY, zeta=0.25),
        entry("/c", "C", None),
    ]
    merge(tmp_path, rows)

    flights = read_table(tmp_path, "flights")
    assert flights.schema.equals(TABLES["flights"].schema)
    assert flights["log_sha256"].to_pylist() == ["A", "B", "C"]  # by date, none last
    assert flights["zeta"].to_pylist() == [0.25, None, None]
    assert flights["used"].to_pylist() == [None, [1, 2], None]
    assert flights["date"][0].as_py() == datetime.datetime(
        2026, 5, 28, 20, 26, 40, tzinfo=datetime.UTC
    )
    assert pq.read_table(tmp_path / "flights.parquet").equals(flights)
    assert read_table(tmp_path, "flights", ["zeta", "boot"]).column_names == ["zeta", "boot"]


def test_the_newest_outcome_of_a_log_replaces_the_older_one_with_all_its_rows(
    tmp_path: Path,
) -> None:
    merge(tmp_path, [entry("/a", "A", MAY), entry("/b", "B", MAY), entry("/c", "C", None)])
    merge(tmp_path, [entry("/a", "A2", None), entry("/b", None)])

    assert read_table(tmp_path, "logs", ["path", "log_sha256"]).to_pylist() == [
        {"path": "/a", "log_sha256": "A2"},
        {"path": "/b", "log_sha256": None},
        {"path": "/c", "log_sha256": "C"},
    ]
    assert read_table(tmp_path, "flights")["log_sha256"].to_pylist() == ["A2", "C"]
    assert read_table(tmp_path, "logs")["outcome"].to_pylist() == ["ok", "crashed", "ok"]


def test_logs_of_the_same_bytes_have_their_flight_once_that_of_an_mcap_only_if_it_is_alone(
    tmp_path: Path,
) -> None:
    log, mcap = entry("/b.tlog", "A", MAY, zeta=0.25), entry("/a.mcap", "A", MAY, zeta=0.5)
    log["logs"][0]["kind"], mcap["logs"][0]["kind"] = "tlog", "mcap"
    for name, order in (
        ("one", [[log], [mcap]]),
        ("other", [[mcap], [log]]),
        ("once", [[mcap, log]]),
    ):
        for entries in order:
            merge(tmp_path / name, entries)
        assert read_table(tmp_path / name, "flights")["zeta"].to_pylist() == [0.25]
    merge(tmp_path / "one", [entry("/other/b.tlog", "A", MAY, zeta=0.25)])
    merge(tmp_path / "one", [entry("/b.tlog", None)])
    assert read_table(tmp_path / "one", "flights")["log_sha256"].to_pylist() == ["A"]
    assert len(read_table(tmp_path / "one", "logs")) == 3


def test_tables_larger_than_a_part_are_whole_and_in_order(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(dataset, "ROWS", 4)
    merge(tmp_path, [entry(f"/{i}", f"{9 - i}", MAY, vehicle=f"v{i % 3}") for i in range(10)])

    flights = read_table(tmp_path, "flights", ["vehicle", "log_sha256"]).to_pylist()
    assert len(flights) == 10
    assert flights == sorted(flights, key=lambda row: (row["vehicle"], row["log_sha256"]))
    assert pq.ParquetFile(tmp_path / "flights.parquet").num_row_groups == 3


def test_what_cannot_be_written_leaves_the_last_files_and_the_next_fleet_writes_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    merge(tmp_path, [entry("/a", "A", MAY)])
    with monkeypatch.context() as patched:

        def full(*_: object) -> None:
            raise OSError(28, "No space left on device")

        patched.setattr(pq.ParquetWriter, "write_table", full)
        with pytest.raises(SinkError, match="No space left on device"):
            merge(tmp_path, [entry("/b", "B", MAY)])
    assert read_table(tmp_path, "flights")["log_sha256"].to_pylist() == ["A"]
    assert not list(tmp_path.glob("*.part"))

    with DataSet(tmp_path):
        pass
    assert read_table(tmp_path, "flights")["log_sha256"].to_pylist() == ["A", "B"]
    before = {path: path.stat().st_mtime_ns for path in tmp_path.iterdir()}
    with DataSet(tmp_path):
        pass
    assert {path: path.stat().st_mtime_ns for path in tmp_path.iterdir()} == before


def test_a_second_fleet_and_a_disk_without_locks_are_refused_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with (
        DataSet(tmp_path),
        pytest.raises(SinkError, match="another yawid fleet is writing to") as said,
    ):
        DataSet(tmp_path)
    assert "\n" not in str(said.value)

    class NoLocks(sqlite3.Connection):
        def execute(self, text: str, *more: Any) -> sqlite3.Cursor:
            if text.startswith("BEGIN"):
                error = sqlite3.OperationalError("disk I/O error")
                error.sqlite_errorname = "SQLITE_IOERR_LOCK"
                raise error
            return super().execute(text, *more)

    connect = sqlite3.connect
    monkeypatch.setattr(sqlite3, "connect", lambda *a, **b: connect(*a, factory=NoLocks, **b))
    with pytest.raises(SinkError, match=r"cannot lock files \(SQLITE_IOERR_LOCK\): choose a fol"):
        DataSet(tmp_path)


def test_what_is_no_data_set_or_of_another_version_is_refused_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(SourceError, match=r"is not a data set: it has no logs\.parquet"):
        read_table(tmp_path, "logs")
    merge(tmp_path, [entry("/a", "A", MAY)])
    for path in (tmp_path / "logs.parquet", tmp_path / "flights.parquet"):
        table = pq.read_table(path)
        pq.write_table(table.drop_columns(table.column_names[-1]), path)
        with pytest.raises(SourceError, match="is of another version of yawid: run yawid fleet"):
            read_table(tmp_path, path.stem)
    with DataSet(tmp_path):
        pass
    assert len(read_table(tmp_path, "flights")) == 1  # whose columns are of this version
    with sqlite3.connect(tmp_path / DATABASE) as database:
        database.execute("PRAGMA user_version = 99")
    database.close()
    with pytest.raises(SourceError, match="has format 99, this version reads 3"):
        DataSet(tmp_path)


def test_a_data_set_holds_its_schema_which_names_every_column(tmp_path: Path) -> None:
    merge(tmp_path, [entry("/a", "A", MAY)])
    page = (tmp_path / PAGE).read_text(encoding="utf-8")
    definitions = json_schema()["$defs"]
    for table in TABLES.values():
        names = table.schema.names
        assert len(set(names)) == len(names)
        assert set(table.keys) | set(table.order) <= set(names)
        assert list(definitions[table.name]["properties"]) == names
        assert all(f"\n| {name} |" in page for name in names)
        assert not any(pa.types.is_float32(kind) for kind in table.schema.types)
