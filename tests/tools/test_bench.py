"""A bench prints a table, says in it what was run, and puts it where readers look."""

from __future__ import annotations

import datetime
import importlib
import inspect
import os
import runpy
import sys
from pathlib import Path
from types import ModuleType

import pytest
from bench import frame as bench
from checks import readme_tables
from places import ROOT


@pytest.fixture
def readme(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A tools/README.md of its own, and a bench called ``fake``."""
    (tmp_path / "tools").mkdir()
    path = tmp_path / "tools" / "README.md"
    path.write_text("<!-- fake -->\n\nwhat follows\n", encoding="utf-8")
    monkeypatch.setattr(readme_tables, "ROOT", tmp_path)
    fake = ModuleType("bench.fake")
    fake.main = lambda options: iter(["| | s |", "|---|---|", f"| {len(options)} | 2 |"])
    monkeypatch.setitem(sys.modules, "bench.fake", fake)
    monkeypatch.setattr(bench, "BENCHES", ("fake",))
    return path


def test_a_bench_writes_its_table_and_names_no_path(readme: Path, capsys):
    paths = [os.sep + name for name in ("one", "two")]

    assert bench.main(["fake", "--readme", "--runs", "4", "--turns", "4", *paths]) == 0

    today = datetime.datetime.now(tz=datetime.UTC).date()
    table = f"| `fake --runs 4 --turns 4 LOG`, {today} | s |\n|---|---|\n| 6 | 2 |\n"
    assert capsys.readouterr().out == table
    assert readme.read_text(encoding="utf-8") == f"<!-- fake -->\n{table}\nwhat follows\n"


def test_a_bench_that_misses_its_aim_exits_with_1_and_its_first_table_is_written(
    readme: Path, monkeypatch: pytest.MonkeyPatch, capsys
):
    def tables(options):
        yield from ("| | s |", "|---|---|", "", "| more |")
        return "s is too large"

    monkeypatch.setattr(sys.modules["bench.fake"], "main", tables)

    assert bench.main(["fake", "--readme"]) == 1

    assert "| more |" in (said := capsys.readouterr()).out
    assert said.err == "s is too large\n"
    assert readme.read_text(encoding="utf-8").endswith("| s |\n|---|---|\n\nwhat follows\n")


@pytest.mark.parametrize("path", sorted((ROOT / "tools").glob("*.py")), ids=lambda path: path.name)
def test_a_tool_in_the_root_runs_as_a_command(
    path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.setattr(sys, "argv", [path.name, "--help"])
    with pytest.raises(SystemExit) as end:
        runpy.run_path(str(path), run_name="__main__")

    assert end.value.code in (0, 2)
    assert "usage: " in "".join(capsys.readouterr())


@pytest.mark.parametrize("name", bench.BENCHES)
def test_every_bench_gives_its_table_line_by_line(name: str):
    assert inspect.isgeneratorfunction(importlib.import_module(f"bench.{name}").main)
