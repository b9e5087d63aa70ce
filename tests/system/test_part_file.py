"""A file whose name ends in .part is somebody's: who opened it removes it, and no other run."""

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
from finished_runs import replayed
from places import C172P, REPLAY_LOGS

import yawid
from yawid.cli.main import main
from yawid.errors import SinkError
from yawid.runs.live.guarded_sink import TlogRecorder
from yawid.runs.stop import Interrupted
from yawid.runs.view import view
from yawid.system.part_file import write_whole, written_whole


@pytest.mark.parametrize(
    ("name", "line"),
    [
        ("log.rrd", f"replay {C172P} --out OUT --rerun save"),
        ("log.rrd", "view RUN --out OUT/log.rrd"),
        ("a.csv", "simulate yaw --seconds 5 --out OUT/a.csv"),
    ],
)
def test_a_command_that_cannot_begin_leaves_anothers_part_alone(
    name: str, line: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other, run = tmp_path / "out" / f"{name}.part", tmp_path / "run"
    other.parent.mkdir()
    other.write_bytes(b"being written")
    if "RUN" in line:
        run = replayed(C172P, run, "--rate", 10)

    words = line.replace("OUT", str(other.parent)).replace("RUN", str(run)).split()
    assert main(words) == 6
    assert f"{other} exists" in capsys.readouterr().err
    assert {path: path.read_bytes() for path in other.parent.iterdir()} == {other: b"being written"}


def test_where_nothing_can_be_written_one_line_says_what_to_do(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "run").touch()

    assert main(["replay", str(C172P), "--out", str(tmp_path / "run")]) == 6
    assert f"{tmp_path / 'run'} is a file: give --out a folder" in capsys.readouterr().err
    if Path("/sys/kernel").is_dir():  # where even root makes no file
        with pytest.raises(SinkError, match=r"/sys/a.*permission denied: choose another folder"):
            write_whole({Path("/sys/a"): b""})


def test_a_view_of_a_damaged_run_and_a_simulation_remove_their_own_parts(tmp_path: Path) -> None:
    run = replayed(C172P, tmp_path / "run", "--rate", 10, "--ordinary", "off", "--lateral", "off")
    data = bytearray(run.read_bytes())
    data[len(data) // 2] ^= 0xFF  # in a chunk: found when the rows are read
    (tmp_path / "bad.mcap").write_bytes(data)

    assert main(["view", str(tmp_path / "bad.mcap"), "--out", str(tmp_path / "mine.rrd")]) == 6
    assert main(["simulate", "yaw", "--seconds", "5", "--out", str(tmp_path / "b.csv")]) == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["b.csv", "bad.mcap", "run"]


def test_a_view_told_to_stop_while_it_opens_leaves_no_part(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = replayed(C172P, tmp_path / "run", "--rate", 10)

    def stopped(target: object, name: str) -> None:
        raise Interrupted(130)

    monkeypatch.setattr("yawid.sinks.rerun.recording.RerunView", stopped)
    with pytest.raises(Interrupted):
        view(run, tmp_path / "mine.rrd")
    assert not list(tmp_path.glob("*.rrd*"))


def test_a_file_that_came_there_while_ours_was_written_is_not_overwritten(tmp_path: Path) -> None:
    theirs, said = tmp_path / "a.tlog", list[str]()

    recorder = TlogRecorder(theirs, said.append, force=False)
    recorder.write(b"ours")
    theirs.write_bytes(b"theirs")
    assert recorder.finish() is None
    assert theirs.read_bytes() == b"theirs"
    assert (tmp_path / "a.tlog.part").read_bytes() == b"ours"
    assert said == [f"{theirs} exists: --force overwrites it: the session goes on without its tlog"]

    theirs = tmp_path / "b.csv"
    writing = written_whole(theirs)
    writing.__enter__().write(b"ours")
    theirs.write_bytes(b"theirs")
    with pytest.raises(SinkError, match="exists"):
        writing.__exit__(None, None, None)
    assert theirs.read_bytes() == b"theirs"

    made = {tmp_path / "c": b"ours", tmp_path / "d": b"ours"}
    recorder = TlogRecorder(tmp_path / "e.tlog", said.append, force=True)
    (tmp_path / "e.tlog").write_bytes(b"theirs")
    assert recorder.finish() == tmp_path / "e.tlog"
    assert (tmp_path / "e.tlog").read_bytes() == b""
    (tmp_path / "d").write_bytes(b"theirs")
    with pytest.raises(SinkError, match="exists"):
        write_whole(made)
    assert not (tmp_path / "c").exists()


BY_SIGNAL = pytest.mark.skipif(sys.platform == "win32", reason="it stops a process by SIGSTOP")
LONG, SHORT = C172P, REPLAY_LOGS / "sitl_fbwa_stock_33hz" / "log.tlog"
FORCED = ["--out", "out", "--manoeuvres", "off", "--ordinary", "off", "--json", "--force"]


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


@BY_SIGNAL
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


@BY_SIGNAL
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
