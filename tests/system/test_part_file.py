"""A file whose name ends in .part is somebody's: who opened it removes it, and no other run."""

from __future__ import annotations

from pathlib import Path

import pytest
from finished_runs import replayed
from places import C172P

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


def test_a_replay_that_fails_removes_its_own_parts(tmp_path: Path) -> None:
    arguments = ["replay", str(C172P), "--out", str(tmp_path), "--rerun", "save", "--rate", "90"]
    assert main(arguments) == 2
    assert list(tmp_path.iterdir()) == []


def test_a_view_of_a_damaged_run_and_a_simulation_remove_their_own_parts(tmp_path: Path) -> None:
    run = replayed(C172P, tmp_path / "run", "--rate", 10, "--ordinary", "off")
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
