"""What a newcomer touches, done in a copy of the house.

An option is added in one file, a number of the answer in two: its field and the page that shows it.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from places import C172P, SRC

OPTION = {
    "config/run.py": {"    turn: Annotated[": """    airport: str | None = field(
        default=None,
        metadata=option(AIRCRAFT, "NAME", "where it was flown (default: unknown)"),
    )
    turn: Annotated["""},
}  # fmt: skip
NUMBER = {
    "answers/model_parts.py": {
        "    level: Count | None = None\n": """    half_s: Annotated[
        Number | None, says("time to half of the amplitude", "s")
    ] = None
    level: Count | None = None
""",
        "            level=dutch_roll_level(": """            half_s=math.log(2.0) / (zeta * wn),
            level=dutch_roll_level(""",
    },
    "sinks/words.py": {
        'return f"{names[0]} {wn} rad/s, {names[1]} {zeta}"':
        'return f"{names[0]} {wn} rad/s, {names[1]} {zeta}, half in {mode.half_s:.3g} s"',
    },
}  # fmt: skip
"""The places where the copy is changed, and what stands there then."""
BEGIN = """
import contextlib, io, json, math
from pathlib import Path
from types import SimpleNamespace
from yawid.cli.main import main
from yawid.sinks.mcap.reader import open_answered

def yawid(*arguments):
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            code = main([*map(str, arguments)])
        except SystemExit as error:
            code = error.code
    return SimpleNamespace(returncode=code, stdout=out.getvalue(), stderr=err.getvalue())
"""
OF_OPTION = """
for words, value in ((["--airport", "LOWI"], "LOWI"), (["--config", "a.toml"], "LOWS")):
    Path("a.toml").write_text('airport = "LOWS"\\n')
    done = yawid("replay", LOG, "--out", "out", "--force", "--to", "80", *words)
    assert done.returncode == 0, done.stderr
    run = open_answered(Path("out/log.mcap"))
    assert run.config.airport == value, run.config
    assert run.metadata["configuration"]["airport"] == value, run.metadata["configuration"]
assert "where it was flown" in yawid("replay", "--help-all").stdout
assert "--airport" in yawid("completion", "bash").stdout
assert "did you mean --airport" in yawid("replay", LOG, "--airprot", "LOWI").stderr
"""
OF_NUMBER = """
done = yawid("replay", LOG, "--out", "out", "--json", "--to", "80")
assert done.returncode == 0, done.stderr
roll = json.loads(done.stdout)["flight"]["dutch_roll"]
assert "half_s" in roll, roll
assert math.isclose(roll["half_s"], math.log(2.0) / (roll["wn_rad_s"] * roll["zeta"]))
kept = open_answered(Path("out/log.mcap")).summary.flight.dutch_roll
assert kept.half_s == roll["half_s"], kept
assert "time to half of the amplitude" in yawid("schema").stdout
assert "half in" in yawid("replay", "out/log.mcap", "--out", "again").stdout
"""


def proven(where: Path, proof: str) -> subprocess.CompletedProcess[str]:
    """Run a proof with the copy of the house."""
    return subprocess.run(
        [sys.executable, "-c", f"LOG = {str(C172P)!r}\n{BEGIN}{proof}"],
        cwd=where, env=os.environ | {"PYTHONPATH": str(where / "src")},
        capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip


@pytest.mark.parametrize(("changes", "proof"), [(OPTION, OF_OPTION), (NUMBER, OF_NUMBER)])
def test_what_is_added_is_its_field_and_its_use_and_without_them_the_proof_fails(
    tmp_path: Path, changes: dict[str, dict[str, str]], proof: str
) -> None:
    house = tmp_path / "src" / "yawid"
    shutil.copytree(SRC, house)
    assert "AssertionError" in proven(tmp_path, proof).stderr

    for name, edits in changes.items():
        text = (house / name).read_text(encoding="utf-8")
        for before, after in edits.items():
            assert text.count(before) == 1
            text = text.replace(before, after)
        (house / name).write_text(text, encoding="utf-8")

    done = proven(tmp_path, proof)
    assert done.returncode == 0, done.stderr
