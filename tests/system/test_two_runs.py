"""Two runs that write one name at the same time, as two processes: one is refused, none mixes."""

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

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="it stops a process by SIGSTOP")
LONG, SHORT = (
    REPLAY_LOGS / name / "log.tlog" for name in ("c172p_three_speeds", "sitl_fbwa_stock_33hz")
)
FORCED = ["--out", "out", "--manoeuvres", "off", "--json", "--force"]


@pytest.fixture
def place(tmp_path: Path) -> Path:
    """Two flights of one name in two folders."""
    for folder, log in (("a", LONG), ("b", SHORT)):
        (tmp_path / folder).mkdir()
        shutil.copy(log, tmp_path / folder / "day.tlog")
    return tmp_path


def command(*words: str) -> list[str]:
    return [sys.executable, "-m", "yawid", "replay", *words]


@contextmanager
def halfway(place: Path) -> Iterator[subprocess.Popen[str]]:
    """A forced replay of the first flight, stopped while it writes its files."""
    with child(
        command("a/day.tlog", *FORCED), cwd=place, stdout=subprocess.PIPE, text=True
    ) as running:
        part, end_s = place / "out" / "day.mcap.part", time.monotonic() + 30.0
        while not part.exists() and time.monotonic() < end_s:
            time.sleep(0.002)
        os.kill(running.pid, signal.SIGSTOP)
        assert part.exists()
        yield running


def second(place: Path, *words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        command("b/day.tlog", *words), cwd=place, capture_output=True, text=True, timeout=60.0
    )


def flight_in(mcap: Path) -> str:
    """Return the hash of the log that a run was made from; every row of it can be read."""
    run = yawid.load(mcap)
    assert len(run.samples) > 100
    return str(run.summary.sha256)


def test_of_two_forced_runs_of_one_name_the_second_is_refused_and_the_first_has_its_own_flight(
    place: Path,
) -> None:
    with halfway(place) as first:
        other = second(place, *FORCED)
        os.kill(first.pid, signal.SIGCONT)
        said, _ = first.communicate(timeout=60.0)

    assert first.returncode == 0
    assert json.loads(said)["sha256"] == sha256(LONG.read_bytes()).hexdigest()
    assert flight_in(place / "out" / "day.mcap") == sha256(LONG.read_bytes()).hexdigest()
    assert other.returncode == 6
    assert other.stderr.count("\n") == 1
    part = place / "out" / "day.mcap.part"
    assert f"another run is writing {part}: wait until it has ended" in other.stderr
    assert [path.name for path in (place / "out").iterdir()] == ["day.mcap"]


def test_what_a_killed_run_left_stops_no_forced_run(place: Path) -> None:
    with halfway(place) as first:
        first.kill()
        first.wait(30.0)
    assert (place / "out" / "day.mcap.part").exists()
    refused = second(place, "--out", "out")
    assert refused.returncode == 6
    assert "move it away or use --force" in refused.stderr

    forced = second(place, *FORCED)
    assert forced.returncode == 0, forced.stderr
    assert flight_in(place / "out" / "day.mcap") == sha256(SHORT.read_bytes()).hexdigest()
    assert [path.name for path in (place / "out").iterdir()] == ["day.mcap"]
