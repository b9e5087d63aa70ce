"""Copies of a store's logs: below a folder of their own, from which no killed fleet leaves any."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path, PureWindowsPath

import pyarrow.parquet as pq
import pytest
from checks.children import child
from places import C172P

from yawid.cli.main import main


def test_the_copy_of_a_log_whose_key_has_backslashes_stays_in_its_folder_on_windows_too(
    tmp_path: Path,
) -> None:
    logs = tmp_path / "logs"
    logs.mkdir()
    (logs / "..\\..\\evil.tlog").write_bytes(b"no log\n")

    assert main(["fleet", f"file://{logs}", "--out", str(tmp_path / "data"), "--workers", "1"]) == 6
    [row] = pq.read_table(tmp_path / "data" / "logs.parquet").to_pylist()
    assert row["path"].endswith("evil.tlog")
    assert row["outcome"] == "unreadable"
    [copy] = [word.rstrip(":") for word in row["text"].split() if "evil.tlog" in word]
    assert PureWindowsPath(copy).name == copy


@pytest.mark.skipif(sys.platform == "win32", reason="the system kills no children there")
def test_what_a_killed_fleet_leaves_of_its_copies_is_removed_by_the_next(tmp_path: Path) -> None:
    logs, data = tmp_path / "logs", tmp_path / "data"
    logs.mkdir()
    (logs / "a.tlog").write_bytes(C172P.read_bytes())
    fleet = ["fleet", f"file://{logs}", "--out", str(data), "--workers", "1"]
    command = [sys.executable, "-m", "yawid", *fleet]

    with child(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        end_s = time.monotonic() + 60.0
        while not [*data.rglob("*.tlog")] and time.monotonic() < end_s:
            time.sleep(0.005)
        process.kill()
        process.wait(60.0)
    assert [*data.rglob("*.tlog")]

    done = subprocess.run(command, capture_output=True, text=True, timeout=60.0)
    assert done.returncode == 0, done.stderr
    assert [each for each in data.iterdir() if each.is_dir()] == []
