"""A data set as others read it: the manual's queries, and its files after kill -9 at any time."""

from __future__ import annotations

import random
import re
import shutil
import signal
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path
from typing import Any

import pandas as pd
import pyarrow.parquet as pq
import pytest
from checks.children import child
from data_sets import JUNE, MAY, entry, merge
from killed_data_sets import killed_at_every_step
from places import SRC, TESTS

from yawid.dataset.files import DataSet, read_table


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


WRITER = """
import sys
from pathlib import Path
from data_sets import MAY, entry
from yawid.dataset.files import DataSet
with DataSet(Path(sys.argv[1])) as data:
    for i in range(100_000):
        data.add(entry(f"/{i}", f"{i}", *[MAY] * 20))
        print(i, flush=True)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="kill -9 is of POSIX")
def test_killed_at_any_time_no_finished_log_is_lost(tmp_path: Path) -> None:
    """The moments of the kills are drawn: also within a transaction, of which SQLite has parts."""
    drawn = random.Random(3)
    for i in range(6):
        folder = tmp_path / f"{i}"
        command = [sys.executable, "-c", WRITER, str(folder)]
        path = f"{TESTS / 'support'}"
        with child(command, stdout=subprocess.PIPE, text=True, cwd=path) as writer:
            assert writer.stdout is not None
            writer.stdout.readline()
            time.sleep(drawn.uniform(0.0, 0.3))
            writer.send_signal(signal.SIGKILL)
            finished = 1 + len(writer.stdout.read().split())
            writer.wait(60.0)
        with DataSet(folder):
            pass
        paths = read_table(folder, "logs", ["path"])["path"].to_pylist()
        assert {f"/{n}" for n in range(finished)} <= set(paths)
        assert len(set(paths)) == len(paths) <= finished + 1
        flown = Counter(read_table(folder, "flights")["log_sha256"].to_pylist())
        assert flown == dict.fromkeys((path[1:] for path in paths), 20)
