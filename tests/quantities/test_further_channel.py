"""A further channel is a row, a field of the blocks, a field of the MCAP, and what reads it."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from places import SRC

CHANGES = {
    "quantities/table.py": (
        'Quantity("ay", "m/s^2", "lateral acceleration; not used"),',
        'Quantity("ay", "m/s^2", "lateral acceleration", "linear", True),',
    ),
    "blocks.py": ("    airspeed_kind: Floats\n", "    airspeed_kind: Floats\n    ay: Floats\n"),
    "sinks/mcap/schemas.py": (
        '("airspeed_kind", "double"),\n    ),',
        '("airspeed_kind", "double"), ("ay", "double"),\n    ),',
    ),
    "channels/yaw_reader.py": (
        '"yaw": unwrapped, "roll": roll}',
        '"yaw": unwrapped, "roll": roll, "ay": np.full(len(block), np.nan)}',
    ),
}
"""Of the house as it stands: that a record has it already is its reader; logs have it not."""
READ = """
import sys, yawid
for run in (yawid.replay(sys.argv[1]), yawid.load(sys.argv[2])):
    samples = run.samples
    assert samples.units["ay"] == "m/s^2"
    good = samples.ay == samples.ay
    assert good.sum() > 1000 and abs(samples.ay - 2.0 * samples.r)[good].max() < 1e-5
"""


@pytest.mark.long
def test_lateral_acceleration_comes_to_samples_tables_and_mcap_by_four_files(tmp_path: Path):
    shutil.copytree(SRC, tmp_path / "src" / "yawid")
    for name, (old, new) in CHANGES.items():
        path = tmp_path / "src" / "yawid" / name
        text = path.read_text()
        assert old in text, name
        path.write_text(text.replace(old, new))
    rows, r, before = [], 0.0, 0.0
    for k in range(2000):
        rudder = 0.3 if k // 40 % 2 and k > 200 else 0.0
        r, before = 1.85 * r - 0.9 * before + 0.02 * rudder, r
        rows.append(f"{0.05 * k:.2f},{rudder},{r:.7f},{2.0 * r:.7f}\n")
    record = tmp_path / "a.csv"
    record.write_text("t,rudder [half-travel],r [rad/s],ay\n" + "".join(rows))
    environment = os.environ | {"PYTHONPATH": str(tmp_path / "src")}

    def run(*arguments: str) -> int:
        command = [sys.executable, *arguments]
        return subprocess.run(command, env=environment, cwd=tmp_path, timeout=120).returncode

    assert run("-m", "yawid", "replay", "a.csv", "--out", "out") in (0, 5)
    assert run("-c", READ, "a.csv", "out/a.mcap") == 0
