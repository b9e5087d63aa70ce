"""Two tables of answers are compared: each kind of change is counted, and each flight is named."""

from __future__ import annotations

from pathlib import Path

import pytest
from cases import answers

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
