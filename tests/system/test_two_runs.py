"""Two runs that write one name at the same time, in two processes: one is refused, none mixes."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from hashlib import sha256
from pathlib import Path

import pytest
from checks.children import child
from places import REPLAY_LOGS

import yawid
from yawid.cli.main import main

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="it stops a process by SIGSTOP")
LONG, SHORT = (
    REPLAY_LOGS / name / "log.tlog" for name in ("c172p_three_speeds", "sitl_fbwa_stock_33hz")
)
FORCED = ["--out", "out", "--manoeuvres", "off", "--json", "--force"]


@pytest.fixture
def part(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Two flights of one name in two folders; return where a run of one is written."""
    for folder, log in (("a", LONG), ("b", SHORT)):
        (tmp_path / folder).mkdir()
        shutil.copy(log, tmp_path / folder / "day.tlog")
    monkeypatch.chdir(tmp_path)
    return Path("out/day.mcap.part")


@contextmanager
def halfway(part: Path) -> Iterator[subprocess.Popen[str]]:
    """A forced replay of the first flight, in a process that is stopped while it writes."""
    command = [sys.executable, "-m", "yawid", "replay", "a/day.tlog", *FORCED]
    with child(command, stdout=subprocess.PIPE, text=True) as running:
        end_s = time.monotonic() + 120.0
        while not part.exists() and time.monotonic() < end_s:
            time.sleep(0.002)
        os.kill(running.pid, signal.SIGSTOP)
        assert part.exists()
        yield running


def assert_is_alone_of(log: Path) -> None:
    """Assert that one run was written, of this log, and that every row of it can be read."""
    run = yawid.load(Path("out/day.mcap"))
    assert len(run.samples) > 100
    assert run.summary.sha256 == sha256(log.read_bytes()).hexdigest()
    assert [path.name for path in Path("out").iterdir()] == ["day.mcap"]


def test_of_two_forced_runs_of_one_name_the_second_is_refused_and_the_first_has_its_own_flight(
    part: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with halfway(part) as first:
        assert main(["replay", "b/day.tlog", *FORCED]) == 6
        os.kill(first.pid, signal.SIGCONT)
        said, _ = first.communicate(timeout=120.0)

    assert first.returncode == 0
    assert json.loads(said)["sha256"] == sha256(LONG.read_bytes()).hexdigest()
    refused = capsys.readouterr().err
    assert refused.count("\n") == 1
    assert f"another run is writing {part.absolute()}: wait until it has ended" in refused
    assert_is_alone_of(LONG)


def test_what_a_killed_run_left_stops_no_forced_run(
    part: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with halfway(part) as first:
        first.kill()
        first.wait(30.0)
    assert part.exists()
    assert main(["replay", "b/day.tlog", "--out", "out"]) == 6
    assert "move it away or use --force" in capsys.readouterr().err

    assert main(["replay", "b/day.tlog", *FORCED]) == 0
    assert_is_alone_of(SHORT)
