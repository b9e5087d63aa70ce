"""What a newcomer touches: an option is added in a copy of the house, in one file, and works."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

from places import C172P, SRC

BEFORE = "    turn: Annotated["
FIELD = """    airport: str | None = field(
        default=None,
        metadata=option(AIRCRAFT, "NAME", "where it was flown (default: unknown)"),
    )
"""
PROOF = """
import subprocess, sys
from pathlib import Path
from yawid.sinks.mcap.reader import open_answered

def yawid(*arguments):
    run = [sys.executable, "-m", "yawid", *map(str, arguments)]
    return subprocess.run(run, capture_output=True, text=True, timeout=120)

for words, value in ((["--airport", "LOWI"], "LOWI"), (["--config", "a.toml"], "LOWS")):
    Path("a.toml").write_text('airport = "LOWS"\\n')
    done = yawid("replay", LOG, "--out", "out", "--force", "--lateral", "off", *words)
    assert done.returncode == 0, done.stderr
    run = open_answered(Path("out/log.mcap"))
    assert run.config.airport == value, run.config
    assert run.metadata["configuration"]["airport"] == value, run.metadata["configuration"]
assert "where it was flown" in yawid("replay", "--help-all").stdout
assert "--airport" in yawid("completion", "bash").stdout
assert "did you mean --airport" in yawid("replay", LOG, "--airprot", "LOWI").stderr
"""


def proven(where: Path, source: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", f"LOG = {str(C172P)!r}\n{PROOF}"],
        cwd=where, env=os.environ | {"PYTHONPATH": str(source)},
        capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip


def test_an_option_is_one_field_and_without_it_the_proof_fails(tmp_path: Path) -> None:
    house = tmp_path / "src" / "yawid"
    shutil.copytree(SRC, house)
    assert "AssertionError" in proven(tmp_path, house.parent).stderr

    run = house / "config" / "run.py"
    text = run.read_text(encoding="utf-8")
    assert text.count(BEFORE) == 1
    run.write_text(text.replace(BEFORE, FIELD + BEFORE), encoding="utf-8")

    done = proven(tmp_path, house.parent)
    assert done.returncode == 0, done.stderr
