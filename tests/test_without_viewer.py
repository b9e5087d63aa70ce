"""A companion computer without rerun-sdk, and so without pyarrow, which comes with it.

It replays, taps, publishes and writes MCAP all the same; what needs one of the two says so.
"""

from __future__ import annotations

import json
import os
import re
import socket
import subprocess
import sys
import tomllib
from pathlib import Path

from checks.children import child
from live_link import frames
from places import ROOT, SRC

LOG = ROOT / "replay_logs" / "c172p_gcs_rates" / "log.tlog"
RUNS = """
import json, sys
from yawid.cli.main import main
print(json.dumps([main(words) for words in json.loads(sys.argv[1])]))
"""


def site_without_viewer(folder: Path) -> str:
    """Return a path of modules with every library that is installed here but these."""
    folder.mkdir()
    for place in filter(Path.is_dir, map(Path, sys.path)):
        for each in place.iterdir() if place.name == "site-packages" else ():
            if not re.match("rerun|pyarrow", each.name) and not (folder / each.name).exists():
                (folder / each.name).symlink_to(each)
    return os.pathsep.join([str(SRC.parent), str(folder)])


def test_all_works_but_what_needs_the_viewer_or_pyarrow_which_says_so_in_one_line(tmp_path: Path):
    path = site_without_viewer(tmp_path / "site")
    (tmp_path / "own.parquet").write_bytes(b"PAR1 and what follows")
    (tmp_path / "own.csv").write_text("t,rudder [deg],r [rad/s]\n0,0,0\n", encoding="utf-8")
    run = "yawid-out/log.mcap"
    without = [
        ["replay", str(LOG), "--rerun", "save", "--out", "other"],
        ["view", run],
        ["export", run, "-o", "run.csv"],
        ["fleet", str(LOG), "--out", "data"],
        ["trend", "data"],
        ["diff", run, run],
        ["replay", "own.parquet"],
        ["replay", "own.csv"],
    ]
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle:
        vehicle.bind(("127.0.0.1", 0))
        vehicle.settimeout(60)
        address = f"udpout:127.0.0.1:{vehicle.getsockname()[1]}"
        live = ["live", address, "--seconds", "3", "--request-rates", "--publish", "tap"]
        able = [["replay", str(LOG), "--manoeuvres", "off"], ["explain", "several_aircraft"]]
        words = [*able, *without, [*live, "--out", "live"]]
        with child(
            [sys.executable, "-S", "-c", RUNS, json.dumps(words)], cwd=tmp_path, text=True,
            env=os.environ | {"NUMBA_DISABLE_JIT": "1", "PYTHONPATH": path},
            stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        ) as process:  # fmt: skip
            heard, yawid = vehicle.recvfrom(2000)
            for frame in frames(1.0):
                vehicle.sendto(frame, yawid)
            while b"yaw_ok" not in heard:
                heard, _ = vehicle.recvfrom(2000)
            said, errors = process.communicate(timeout=60)

    lines = [line for line in errors.splitlines() if "is not installed here" in line]
    assert len(lines) == len(without), errors
    assert all(re.search("(rerun|pyarrow) is not .*pip install rerun-sdk", line) for line in lines)
    codes = json.loads(said.splitlines()[-1])
    assert codes == [0, 0, *[6] * len(without), 5], errors
    assert (tmp_path / run).stat().st_size > 10_000
    assert {path.suffix for path in (tmp_path / "live").iterdir()} == {".tlog", ".mcap"}
    assert not (tmp_path / "data").exists()


def test_the_manuals_list_has_every_library_but_rerun_sdk_and_pyarrow():
    page = (SRC / "manual" / "platforms.md").read_text(encoding="utf-8")
    [said] = re.findall(r"pip install (numpy (?:.*\\\n)*.*)", page)
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    needed = {re.split("[<>=]", each)[0] for each in project["dependencies"]}
    assert set(re.findall(r"[a-z][a-z0-9-]+", said)) == needed - {"rerun-sdk", "pyarrow"}
