"""A data set as others read it: the manual's queries, and a glob after kill -9 at every step."""

from __future__ import annotations

import re
import shutil
from collections import Counter
from pathlib import Path
from typing import Any

import pandas as pd
import pyarrow.parquet as pq
import pytest
from killed_merge import killed_at_every_step
from places import SRC

from yawid.dataset.files import completed, merge, read_table

KEYS = {"yawid_version": "0", "analysis_version": "1", "config_hash": "c"}
MAY, JUNE = 1_780_000_000_000_000, 1_782_000_000_000_000


def entry(path: str, sha: str | None, *dates: int | None, **values: Any) -> Any:
    """Return a log with a boot for each of ``dates``."""
    log = {"path": path, "log_sha256": sha, "outcome": "ok" if sha else "crashed", **KEYS}
    keys = {"log_sha256": sha, "sysid": 1, "vehicle": "sysid:1", "usable": True, **KEYS, **values}
    flights = [keys | {"boot": boot, "date": date} for boot, date in enumerate(dates, 1)]
    return {"logs": [log], "flights": flights}


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
    assert sorted(zip(usable["month"], usable["zeta"], strict=True)) == [
        ("2026-05", 0.25),
        ("2026-06", 0.25),
        ("unknown", 0.5),
    ]
    select = re.search(r"`duckdb -c \"select (.*?) from '(.*?)'\"`", page)
    assert select is not None
    found = by_glob(Path(), select[2], *select[1].split(", "))
    assert Counter((vehicle, zeta) for vehicle, _, zeta in found) == {
        ("sysid:1", 0.25): 2,
        ("sysid:1", 0.5): 1,
        ("sysid:1", None): 1,
    }


def test_an_undated_month_of_an_older_version_gets_the_new_name_by_the_next_merge(
    tmp_path: Path,
) -> None:
    merge(tmp_path, [entry("/a", "A", None)])
    old = tmp_path / "flights" / "month=__HIVE_DEFAULT_PARTITION__"
    (tmp_path / "flights" / "month=unknown").rename(old)
    manifest = tmp_path / "manifest.json"
    manifest.write_text(
        manifest.read_text(encoding="utf-8").replace("month=unknown", old.name), encoding="utf-8"
    )
    assert read_table(tmp_path, "flights")["log_sha256"].to_pylist() == ["A"]

    merge(tmp_path, [entry("/b", "B", MAY)])

    months = sorted(path.name for path in (tmp_path / "flights").iterdir())
    assert months == ["month=2026-05", "month=unknown"]
    assert read_table(tmp_path, "flights")["log_sha256"].to_pylist() == ["B", "A"]


FIRST = [entry("/a", "A", MAY, JUNE), entry("/b", "B", MAY), entry("/c", "C", None)]
SECOND = [entry("/a", "A", MAY, None, zeta=0.5), entry("/b", None), entry("/d", "D", JUNE)]
EACH_MERGED = 5
"""Of so many merges that were killed one is done again, which costs more than a look."""
ROWS = ("log_sha256", "boot", "zeta")
BEFORE = {("A", 1, None), ("A", 2, None), ("B", 1, None), ("C", 1, None)}
AFTER = {("A", 1, 0.5), ("A", 2, 0.5), ("C", 1, None), ("D", 1, None)}


@pytest.mark.parametrize("is_new", [False, pytest.param(True, marks=pytest.mark.long)])
def test_killed_at_any_step_a_glob_reads_no_row_twice_and_the_next_merge_completes(
    tmp_path: Path, is_new: bool
) -> None:
    start, whole = tmp_path / "start", tmp_path / "whole"
    start.mkdir()
    if not is_new:
        merge(start, FIRST)
    entries, before, after = (FIRST, set(), BEFORE) if is_new else (SECOND, BEFORE, AFTER)
    shutil.copytree(start, whole)
    merge(whole, entries)
    *killed, not_killed = killed_at_every_step(start, entries, tmp_path)
    assert len(killed) > 10
    assert files(not_killed) == files(whole)
    shorts = 0
    for i, folder in enumerate(killed):
        seen = by_glob(folder, "flights/**/*.parquet", *ROWS)
        assert len({row[:2] for row in seen}) == len(seen), folder
        assert set(seen) <= before or set(seen) <= after, folder
        shorts += set(seen) not in (before, after)
        if (folder / "manifest.json").exists():
            rows = read_table(folder, "flights", ROWS).to_pylist()
            told = {tuple(row.values()) for row in rows}
            assert len(rows) == len(told)
            assert told in (before, after), folder
            completed(folder)
            assert set(by_glob(folder, "flights/**/*.parquet", *ROWS)) == told
            assert not (folder / "_new").exists()
        if i % EACH_MERGED == 0:
            merge(folder, entries)
            assert len(files(folder)) == len(files(whole))
            for name in ("logs", "flights"):
                assert read_table(folder, name).equals(read_table(whole, name))
    assert shorts > 0


def files(folder: Path) -> set[str]:
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}
