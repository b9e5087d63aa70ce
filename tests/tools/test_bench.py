"""A bench prints a table, says in it what was run, and puts it where readers look."""

from __future__ import annotations

import datetime
import math
import os
import sys
from collections.abc import Iterable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from bench import frame as bench
from checks import readme_tables


def tables(options: Any) -> list[Iterable[str]]:
    """A bench of two tables, of which the second is not in the README, and a missed aim."""
    return [
        bench.table("", {options.logs[:1]: {"s": options.runs}, "b": {"s": math.nan}}),
        bench.table("more", {"c": {"s": 3}}),
        [f"{bench.NOT_MET}s is too large"] * (options.runs > 4),
    ]


@pytest.fixture
def readme(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A tools/README.md of its own, and a bench called ``fake``."""
    (tmp_path / "tools").mkdir()
    path = tmp_path / "tools" / "README.md"
    path.write_text("<!-- fake -->\n\nwhat follows\n", encoding="utf-8")
    monkeypatch.setattr(readme_tables, "ROOT", tmp_path)
    monkeypatch.setitem(sys.modules, "bench.fake", SimpleNamespace(fake=tables))
    monkeypatch.setattr(bench, "BENCHES", {"fake": ("fake", {"runs": 2, "logs": ""})})
    return path


@pytest.mark.parametrize(("runs", "missed"), [("4", ""), ("5", "\nnot met: s is too large\n")])
def test_a_bench_writes_its_table_names_no_path_and_exits_with_1_if_it_misses_an_aim(
    runs: str, missed: str, readme: Path, capsys
):
    code = bench.main(["fake", "--readme", "--runs", runs, "--logs", f"{os.sep}one"])

    today = datetime.datetime.now(tz=datetime.UTC).date()
    head = f"| `fake --runs {runs} --logs LOG`, {today} | s |\n|---|---|\n"
    table = f"{head}| / | {runs} |\n| b | - |\n"
    assert code == (missed != "")
    assert capsys.readouterr().out == f"{table}\n| more | s |\n|---|---|\n| c | 3 |\n{missed}"
    assert readme.read_text(encoding="utf-8") == f"<!-- fake -->\n{table}\nwhat follows\n"
