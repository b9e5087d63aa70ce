"""What goes wrong around a session is one line each, and the rest goes on."""

from __future__ import annotations

import errno
import os
import shutil
import subprocess
import threading
import time
from dataclasses import asdict
from pathlib import Path

import pytest
from checks.children import LEAVE_S, child
from flights.surgery import split
from live_link import CONFIG, frames, listening, send, tlog_size, wait_for_size
from sinks.rerun.rerun_reading import VIEWER
from sinks.rerun.test_viewer import viewer

from yawid.runs.live import Console
from yawid.runs.live.guarded_sink import TlogRecorder
from yawid.runs.outputs import Outputs
from yawid.runs.replay import StopFlag, replay
from yawid.sources.link.inbox import Stamps


def lines_with(text: str, screen: object) -> list[str]:
    return [line for line in screen.getvalue().splitlines() if text in line]  # type: ignore[attr-defined] # a StringIO


@pytest.mark.parametrize(("full", "whole"), [("tlog", "mcap"), ("mcap", "tlog")])
def test_a_full_disk_under_one_file_is_one_line_and_the_other_goes_on(
    full: str, whole: str, tmp_path: Path
):
    # /dev/full says ENOSPC to every write, as a full disk does.
    (tmp_path / f"live.{full}.part").symlink_to("/dev/full")
    with listening(tmp_path, outputs=Outputs(tmp_path, "live", force=True)) as session:
        sent = frames(20.0)
        send(sent, session.port)
        session.screen.wait_for("No space left")
        session.screen.wait_for("tracking")
    [ended] = session.ended
    assert len(lines_with("No space left", session.screen)) == 1
    assert ended.exit_code == 6
    assert set(ended.summary.files) == {whole}
    assert len(ended.summary.live.failed) == 1
    assert ended.summary.estimates["els"].updates > 100
    assert full == "tlog" or (tmp_path / "live.tlog").stat().st_size == tlog_size(sent)


def test_a_disk_that_fails_as_a_file_is_brought_to_it_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    fsync = os.fsync

    def fail(descriptor: int) -> None:
        if threading.current_thread().name == "yawid-disk":
            raise OSError(errno.EIO, os.strerror(errno.EIO))
        fsync(descriptor)

    monkeypatch.setattr("os.fsync", fail)
    with listening(tmp_path) as session:
        send(frames(20.0), session.port)
        session.screen.wait_for("live.mcap.part: Input/output error: the session goes on")
        session.screen.wait_for("tracking")
    [ended] = session.ended
    assert len(lines_with("Input/output error", session.screen)) == 1
    assert (ended.exit_code, set(ended.summary.files)) == (6, {"tlog"})


def test_a_removed_folder_is_one_line_for_each_file_and_the_estimate_goes_on(tmp_path: Path):
    folder = tmp_path / "out"
    with listening(folder) as session:
        send(frames(10.0), session.port)
        wait_for_size(session.part("tlog"), 1)
        shutil.rmtree(folder)
        session.screen.wait_for("live.tlog.part has been removed")
        session.screen.wait_for("live.mcap.part has been removed")
        send(frames(20.0, first_s=110.0), session.port)
        session.screen.wait_for("tracking")
    [ended] = session.ended
    assert len(lines_with("has been removed", session.screen)) == 2
    assert (ended.exit_code, ended.summary.files) == (6, {})


@pytest.mark.parametrize("jump_s", [-7200, 7200])
def test_a_clock_that_is_set_is_one_line_and_no_stamp_moves(
    jump_s: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    ahead_ns = [0]
    stamps = Stamps(lambda: time.time_ns() + ahead_ns[0])
    monkeypatch.setattr("yawid.runs.live.loop.Stamps", lambda: stamps)
    with listening(tmp_path) as session:
        send(frames(10.0), session.port)
        wait_for_size(session.part("tlog"), 1)
        ahead_ns[0] = jump_s * 1_000_000_000
        session.screen.wait_for("clock jumped")
        send(frames(10.0, first_s=110.0), session.port)
        session.screen.wait_for("tracking")
    [ended] = session.ended
    assert lines_with(f"this machine's clock jumped by {jump_s:+.1f} s", session.screen) != []
    assert len(lines_with("clock jumped", session.screen)) == 1
    stamped = [us for us, _ in split((tmp_path / "live.tlog").read_bytes())]
    assert stamped == sorted(stamped)
    assert stamped[-1] - stamped[0] < 60_000_000
    assert (
        ended.summary.link.clock_steps,
        ended.summary.link.reboots,
    ) == (0, 0)


def test_a_file_is_called_removed_when_it_is_and_not_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr("yawid.runs.live.guarded_sink.LOOK_S", 0.0)
    said: list[str] = []
    recorder = TlogRecorder(tmp_path / "live.tlog", said.append, force=False)
    recorder.look()
    assert (recorder.failure, said) == (None, [])

    (tmp_path / "live.tlog.part").unlink()
    recorder.look()
    recorder.look()
    assert recorder.finish() is None
    assert recorder.failure == f"{tmp_path / 'live.tlog.part'} has been removed"
    assert said == [f"{recorder.failure}: the session goes on without its tlog"]


def test_a_viewer_that_dies_is_one_line_and_the_files_are_whole(tmp_path: Path):
    with viewer("--serve-grpc") as (address, process):
        with listening(tmp_path, outputs=Outputs(tmp_path, "live", address)) as session:
            send(frames(10.0), session.port)
            session.screen.wait_for("tracking")
            process.kill()
            process.wait(LEAVE_S)
            send(frames(10.0, first_s=110.0), session.port)
            session.screen.wait_for("no Rerun viewer")
            send(frames(10.0, first_s=120.0), session.port)
        [ended] = session.ended
    assert len(lines_with("no Rerun viewer", session.screen)) == 1
    assert set(ended.summary.files) == {"mcap", "tlog"}
    assert ended.exit_code in (0, 5)
    assert any("no Rerun viewer" in event for event in ended.summary.live.events)


def test_a_part_left_by_a_crash_replays_as_it_is(tmp_path: Path):
    with listening(tmp_path) as session:
        sent = frames(20.0)
        send(sent, session.port)
        wait_for_size(session.part("tlog"), tlog_size(sent))
        torn = tmp_path / "torn.tlog.part"
        torn.write_bytes(session.part("tlog").read_bytes()[:-7])
    summary = replay(torn, asdict(CONFIG), Outputs(tmp_path, "again"), StopFlag())
    assert summary.link.frames == len(sent) - 1


def test_the_stream_the_session_talks_to_may_be_gone(tmp_path: Path):
    """A terminal that was closed must not end the recording."""
    with child(["true"], stdin=subprocess.PIPE, text=True) as gone:
        gone.wait(LEAVE_S)
        console = Console(gone.stdin)
        console.say("still flying")
        console.show("12 msg/s")


def test_a_viewer_that_comes_back_is_shown_what_follows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr("yawid.runs.live.viewer_thread.AGAIN_S", 0.1)
    with (
        viewer("--serve-grpc") as (address, process),
        listening(tmp_path, outputs=Outputs(tmp_path, "live", address)) as session,
    ):
        send(frames(10.0), session.port)
        session.screen.wait_for("tracking")
        process.kill()
        process.wait(LEAVE_S)
        session.screen.wait_for("no Rerun viewer")
        sent = frames(5.0, first_s=110.0)
        for at in range(0, len(sent), 25):  # while it looks for the viewer and finds none
            send(sent[at : at + 25], session.port)
            time.sleep(0.1)
        port = address.rpartition(":")[2].partition("/")[0]
        with child(
            [VIEWER, "--serve-grpc", "--bind", "127.0.0.1", "--port", port],
            stderr=subprocess.DEVNULL,
        ):
            session.screen.wait_for("the Rerun viewer is back")
            send(frames(5.0, first_s=115.0), session.port)
    [ended] = session.ended
    els = ended.summary.estimates["els"]
    assert 0 < ended.summary.live.viewer_skipped < els.held + els.updates
