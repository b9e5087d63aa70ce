"""A data set: its rows by hand, what others read of it, and its files after kill -9 at any time."""

from __future__ import annotations

import datetime
import math
import re
import shutil
import sqlite3
from collections import Counter
from pathlib import Path
from typing import Any

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from data_sets import JUNE, MAY, entry, killed_at_every_step, merge
from hand_flights import by_ct, estimate, manoeuvre, mixed_loops, roll_of, summary
from msgspec.structs import replace
from places import SRC

from yawid.answers.reasons import Verdict
from yawid.answers.run_summary import Bare, DutchRoll, TimeConstant
from yawid.dataset import files as dataset
from yawid.dataset.files import DATABASE, PAGE, DataSet, read_table, table_of
from yawid.dataset.schema import TABLES, json_schema
from yawid.dataset.summary_rows import flight_rows, manoeuvre_rows
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


def test_a_data_set_that_is_there_has_one_fleet_at_a_time(tmp_path: Path) -> None:
    merge(tmp_path, [entry("/a", "A", MAY)])
    with DataSet(tmp_path), pytest.raises(SinkError, match="another yawid fleet is writing"):
        DataSet(tmp_path)


def test_a_disk_without_locks_is_refused_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
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


@pytest.mark.parametrize("depth", [1_500, 100_000])
def test_rows_that_are_nested_too_deeply_are_refused_in_one_line(
    depth: int, tmp_path: Path
) -> None:
    merge(tmp_path, [])
    database = sqlite3.connect(tmp_path / DATABASE)
    database.execute("INSERT INTO rows VALUES ('/b', 'logs', ?)", ["[" * depth + "]" * depth])
    database.commit()
    database.close()
    with pytest.raises((SourceError, SinkError), match=rf"^.*{DATABASE}.*$") as caught:
        merge(tmp_path, [entry("/a", "A", MAY)])
    assert "\n" not in str(caught.value)


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


def test_kappa_and_k_over_v_and_all_their_sigmas_are_divided_by_the_airspeed() -> None:
    # wn 10.07, total sigma .11, of noise .03; K .308, .006, .002; V 21.6.
    (row,) = manoeuvre_rows(summary([manoeuvre(1, 10.07, speed=21.6)], None))

    expected = {
        "kappa_rad_m": 0.466_203_7,
        "kappa_std": 0.005_092_593,
        "kappa_std_noise": 0.001_388_889,
        "K_per_V": 0.014_259_26,
        "K_per_V_std": 0.000_277_777_8,
        "K_per_V_std_noise": 0.000_092_592_6,
    }
    assert {name: row[name] for name in expected} == pytest.approx(expected, rel=1e-5)
    for speed, source in ((21.6, "ground_speed"), (None, None)):
        (row,) = manoeuvre_rows(summary([manoeuvre(1, speed=speed, airspeed_source=source)], None))
        assert not expected.keys() & row.keys()


def test_each_loop_of_a_flight_is_a_row_and_its_headline_the_first() -> None:
    rows = flight_rows(mixed_loops(), 1, 268.0)

    assert [(row["loop"], row["wn_rad_s"], row["used"], row["usable"]) for row in rows] == [
        ("with_roll_loop", 10.21, [2], True),
        ("airframe", 10.4, [1], True),
        ("unknown", 10.3, [3], True),
    ]
    assert {row["manoeuvres"] for row in rows} == {3}
    assert [row["used"] for row in manoeuvre_rows(mixed_loops())] == [True] * 3
    [stream] = flight_rows(summary(None, None), 1, 268.0)
    assert (stream["answer"], stream["usable"]) == ("stream", False)


def test_the_bare_airframe_is_in_the_rows_of_its_flight_and_of_its_manoeuvre() -> None:
    usable = Verdict(usable=True, reasons=[])
    roll = DutchRoll(wn_rad_s=10.3, wn_std=0.2, zeta=0.63, zeta_std=0.02, level=1)
    bare = Bare(dutch_roll=roll, roll_mode=TimeConstant(0.1, 0.01), airspeed_m_s=22.7,
                used=[1], verdict=usable)  # fmt: skip
    refused = Bare(used=[2], verdict=Verdict(usable=False, reasons=[]))
    two = [replace(manoeuvre(1), lateral=bare), replace(manoeuvre(2), lateral=refused)]
    run = replace(summary(two, None), bare=bare)

    expected = {
        "bare_wn_rad_s": 10.3, "bare_wn_std": 0.2, "bare_zeta": 0.63, "bare_zeta_std": 0.02,
        "bare_level": 1, "bare_roll_mode_s": 0.1, "bare_roll_mode_std": 0.01,
        "bare_airspeed_m_s": 22.7,
    }  # fmt: skip
    first, second = manoeuvre_rows(run)
    for row in (flight_rows(run, 1, 268.0)[0], first):
        assert {name: row[name] for name in expected} == expected
        assert table_of(TABLES["flights"], [{name: row[name] for name in expected}]).num_rows == 1
    assert not [name for name in second if name.startswith("bare")]


def test_what_els_and_rml_had_at_the_end_of_a_manoeuvre_stands_under_their_own_names() -> None:
    els, rml = estimate("els", roll_of(9.7, 0.55)), estimate("rml", roll_of(10.4, 0.7))
    for order in ((els, rml), (rml, els)):
        answers = {"ct": by_ct(roll_of(10.2, 0.62))} | {each.method: each for each in order}
        flown = replace(manoeuvre(1), estimates=answers)
        (row,) = table_of(TABLES["manoeuvres"], manoeuvre_rows(summary([flown], None))).to_pylist()

        assert (row["wn_rad_s"], row["zeta"]) == (10.2, 0.62)
        assert (row["els_wn_rad_s"], row["els_zeta"]) == (9.7, 0.55)
        assert (row["rml_wn_rad_s"], row["rml_zeta"]) == (10.4, 0.7)

    alone = replace(manoeuvre(1), estimates={"ct": by_ct(roll_of(10.2, 0.62)), "els": els})
    (row,) = manoeuvre_rows(summary([alone], None))
    assert not [name for name in row if name.startswith("rml")]


def by_glob(folder: Path, pattern: str, *columns: str) -> list[tuple[Any, ...]]:
    """Return rows as DuckDB reads them: its globs match hidden names, and ** any depth."""
    names = folder.glob(pattern)  # so do pathlib's
    rows = [row for name in names for row in pq.ParquetFile(name).read(columns).to_pylist()]
    return [tuple(row[column] for column in columns) for row in rows]


def test_the_manuals_own_queries_read_a_data_set_with_undated_flights(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    page = (SRC / "manual" / "fleet.md").read_text(encoding="utf-8")
    dated, undated = entry("/a", "A", MAY, JUNE, zeta=0.25), entry("/b", "B", None, zeta=0.5)
    bad = entry("/c", "C", None, usable=False)
    merge(tmp_path / "DATA", [dated, undated, bad])
    monkeypatch.chdir(tmp_path)

    query = re.search(r"`(pandas\.read_parquet\(.*?\))`", page)
    assert query is not None
    usable = eval(query[1], {"pandas": pd})  # the line that the manual says to write
    assert usable["zeta"].to_list() == [0.25, 0.25, 0.5]  # by date, those without one last
    select = re.search(r"`duckdb -c \"select (.*?) from '(.*?)'\"`", page)
    assert select is not None
    found = by_glob(Path(), select[2], *select[1].split(", "))
    assert Counter((vehicle, zeta) for vehicle, _, zeta in found) == {
        ("sysid:1", 0.25): 2,
        ("sysid:1", 0.5): 1,
        ("sysid:1", None): 1,
    }


FIRST = [entry("/a", "A", MAY, JUNE), entry("/b", "B", MAY), entry("/c", "C", None)]
SECOND = [entry("/a", "A", MAY, None, zeta=0.5), entry("/b", None), entry("/d", "D", JUNE)]
EACH_MERGED = 4
"""Of so many writers that were killed one is done again, which costs more than a look."""
ROWS = ("log_sha256", "boot", "zeta")
BEFORE = {("A", 1, None), ("A", 2, None), ("B", 1, None), ("C", 1, None)}
AFTER = {("A", 1, 0.5), ("A", 2, 0.5), ("C", 1, None), ("D", 1, None)}


def test_killed_at_any_step_a_glob_reads_the_old_rows_or_the_new_ones_and_the_next_fleet_goes_on(
    tmp_path: Path,
) -> None:
    start, whole = tmp_path / "start", tmp_path / "whole"
    merge(start, FIRST)
    shutil.copytree(start, whole)
    merge(whole, SECOND)
    *killed, not_killed = killed_at_every_step(start, SECOND, tmp_path)
    assert len(killed) > 30
    assert files(not_killed) == files(whole)
    seen_both = set()
    for i, folder in enumerate(killed):
        seen = by_glob(folder, "**/flights.parquet", *ROWS)
        assert len(set(seen)) == len(seen), folder
        assert set(seen) in (BEFORE, AFTER), folder
        seen_both.add(set(seen) == AFTER)
        if i % EACH_MERGED:
            continue
        with DataSet(folder) as data:
            known = data.known()
        found = by_glob(folder, "**/flights.parquet", *ROWS)
        assert len({row[:2] for row in found}) == len(found), folder
        for path, sha in (("/a", "A"), ("/b", "B"), ("/d", "D")):  # each log as before or as after
            rows, of = {row for row in found if row[0] == sha}, (sha, path)
            states = [{row for row in each if row[0] == sha} for each in (BEFORE, AFTER)]
            assert rows in states, (folder, of)
            assert rows == set() or path in known, (folder, of)
        merge(folder, SECOND)
        assert files(folder) == files(whole), folder
        for name in ("logs", "flights"):
            assert read_table(folder, name).equals(read_table(whole, name))
    assert seen_both == {False, True}


def files(folder: Path) -> set[str]:
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}
