"""The paper's figures come from our own runs."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from places import ROOT


def test_every_transient_of_the_paper_is_drawn(tmp_path: Path):
    tool = [sys.executable, "-m", "pictures.paper_figures", str(tmp_path)]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([f"{ROOT}/src", f"{ROOT}/tools"])}
    done = subprocess.run(
        tool, env=environment, capture_output=True, text=True, check=False, timeout=120
    )

    assert done.returncode == 0, done.stderr
    drawn = (tmp_path / "paper_figures.svg").read_text(encoding="utf-8")
    for figure in ("1", "2", "2.3", "2.4"):
        assert f"<!-- Figure {figure}: " in drawn
    assert "(fits its own record 100 %)" in drawn
    assert (tmp_path / "paper_figures.png").stat().st_size > 10_000
