"""The paper's figures come from our own runs."""

from __future__ import annotations

from pathlib import Path

from pictures import paper_figures


def test_every_transient_of_the_paper_is_drawn(tmp_path: Path):
    paper_figures.main(tmp_path)

    drawn = (tmp_path / "paper_figures.svg").read_text(encoding="utf-8")
    for figure in ("1", "2", "2.3", "2.4"):
        assert f"<!-- Figure {figure}: " in drawn
    assert "(fits its own record 100 %)" in drawn
    assert (tmp_path / "paper_figures.png").stat().st_size > 10_000
