"""The bench of real records: what meets its reference, and what does not."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from bench import real
from places import C172P

HEAD = "file, options, wn, zeta, tolerance\n"


@pytest.mark.parametrize(
    ("wn", "found", "met", "off"),
    [
        ("2.0", {"wn_rad_s": 2.05, "zeta": 0.25}, True, "+2.5, +0.050"),
        ("2.0", {"wn_rad_s": 2.08, "zeta": 0.2}, False, "+4.0, +0.000"),
        ("2.0", {"wn_rad_s": 2.0, "zeta": 0.27}, False, "+0.0, +0.070"),
        ("2.0", None, False, ""),
        ("refuse", None, True, ""),
        ("refuse", {"wn_rad_s": 2.0, "zeta": 0.2}, False, ""),
    ],
)
def test_an_answer_meets_its_reference_within_the_tolerance(
    wn: str, found: dict[str, object] | None, met: bool, off: str
) -> None:
    reference = {"file": "a.tlog", "options": "", "wn": wn, "zeta": "0.2", "tolerance": "3 0.06"}
    row = real.judged(reference, found, "")

    assert (row["met"], row["off"]) == (met, off)


@pytest.mark.long
def test_a_folder_is_replayed_with_the_options_of_its_table(tmp_path: Path) -> None:
    shutil.copy(C172P, tmp_path / "flown.tlog")
    (tmp_path / real.TABLE).write_text(
        # JSBSim's own linearisation says 2.404 and 0.233. Its first 10 s hold nothing.
        HEAD + "flown.tlog,, 2.404, 0.233, 3 0.02\nflown.tlog, --to 34, refuse,,\n",
        encoding="utf-8",
    )
    lines = real.main([str(tmp_path), "--jobs", "1"])

    first = [next(lines) for _ in range(8)]
    assert first[2] == "| flown | 2 | 1 | 0 | 1 | 0 |"
    assert [line.split("|")[-2].strip() for line in first[6:]] == ["yes", "yes"]
    assert "not_excited" in first[7]
    with pytest.raises(StopIteration) as end:
        next(lines)
    assert end.value.value is None


def test_a_folder_without_a_table_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SystemExit, match="does not exist"):
        next(real.main([str(tmp_path)]))
    (tmp_path / real.TABLE).write_text("file,wn\na.tlog,2\n", encoding="utf-8")
    with pytest.raises(SystemExit, match="lacks the columns options, tolerance, zeta"):
        next(real.main([str(tmp_path)]))
