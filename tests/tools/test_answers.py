"""Two tables of answers are compared: each kind of change is counted, and each flight is named."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from cases import answers
from places import C172P

HEAD = "log,exit_code,usable,wn,wn_std,zeta,zeta_std,reasons,manoeuvres,usable_manoeuvres"
OLD = "f/a.tlog,0,True,2,0.1,0.2,0.02,,2,2"


def table(folder: Path, name: str, *rows: str) -> Path:
    path = folder / name
    path.write_text("\n".join([HEAD, *rows, ""]), encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("new", "ways", "said"),
    [
        # a step of .005 is .05 of the sigma .1 and .25 % of 2; one of .05 is .5 and 2.5 %
        ("0,True,2.005,0.1,0.2,0.02,,2,2", "wn moved by at most 0.1 sigma", "+0.25 %, 0.05 sigma"),
        ("0,True,2.05,0.1,0.2,0.02,,2,2", "wn moved by at most 1 sigma", "+2.50 %, 0.50 sigma"),
        ("0,True,2,0.1,0.15,0.02,,2,2", "zeta moved more", "-25.00 %, 2.50 sigma"),
        ("0,True,2,0.2,0.2,0.02,,2,2", "wn moved by at most 0.1 sigma", "2±0.1 to 2±0.2"),
        ("5,False,,,0.2,0.02,,2,2", "exit code 0 to 5; wn came or went", "2±0.1 to none±"),
        ("0,True,2,0.1,0.2,0.02,rate_low,2,2", "other reasons", "no reasons to rate_low"),
        ("0,True,2,0.1,0.2,0.02,,2,1", "number of usable_manoeuvres", "2 to 1 usable_manoeuvres"),
    ],
)
def test_a_changed_answer_is_counted_by_its_kind_and_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], new: str, ways: str, said: str
) -> None:
    same = OLD.replace("a.tlog", "b.tlog")
    old = table(tmp_path, "old.csv", OLD, same)
    now = table(tmp_path, "new.csv", f"f/a.tlog,{new}", same)

    assert answers.main([str(now), "--against", str(old)]) == 1

    counted, _, named = capsys.readouterr().out.partition("\n\n")
    head, _, none, *counts = counted.splitlines()
    assert (head, none) == ("| change | flights |", "| none | 1 |")
    assert counts == [f"| {way} | 1 |" for way in ways.split("; ")]
    assert named.startswith("f/a.tlog: ")
    assert said in named
    assert "b.tlog" not in named


def test_a_flight_that_only_one_table_has_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    old = table(tmp_path, "old.csv", OLD, OLD.replace("a.tlog", "gone.tlog"))
    new = table(tmp_path, "new.csv", OLD)

    assert answers.main([str(new), "--against", str(old)]) == 1
    assert "| only in the earlier table: f/gone.tlog | 1 |" in capsys.readouterr().out
    assert answers.main([str(new), "--against", str(new)]) == 0


def test_the_logs_of_a_folder_are_replayed_and_a_log_that_fails_has_its_exit_code(
    tmp_path: Path,
) -> None:
    folder = tmp_path / "flown"
    (folder / "below").mkdir(parents=True)
    shutil.copy(C172P, folder / "below" / "good.tlog")
    (folder / "bad.tlog").write_bytes(b"no frames at all " * 100)
    path = tmp_path / "table.csv"

    assert answers.main([str(path), str(folder)]) == 0

    rows = answers.read(path)
    assert list(rows) == ["flown/bad.tlog", "flown/below/good.tlog"]
    bad, good = rows.values()
    assert (bad["usable"], bad["wn"], bad["manoeuvres"]) == ("False", "", "0")
    assert bad["exit_code"] not in ("0", "5")
    # JSBSim's own linearisation says 2.404 and 0.233
    assert abs(float(good["wn"]) - 2.404) < 2.0 * float(good["wn_std"])
    assert abs(float(good["zeta"]) - 0.233) < 2.0 * float(good["zeta_std"])
    assert (good["exit_code"], good["usable"], good["usable_manoeuvres"]) == ("0", "True", "1")
