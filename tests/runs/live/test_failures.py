"""What goes wrong in and around a session is one line each, and the rest goes on."""

from __future__ import annotations

import errno
import os
import re
import subprocess
import threading
import time
from collections.abc import Callable
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

import pytest
from checks.children import LEAVE_S, child
from flights.surgery import split
from live_link import Session, frames, listening, mixed, send, tlog_size, wait_for_size, wait_until
from sinks.rerun.rerun_reading import VIEWER, recorded
from sinks.rerun.test_viewer import viewer

from yawid.runs.outputs import Outputs
from yawid.sinks.mcap.reader import open_run
from yawid.sources.link.inbox import Stamps

SENT = {sysid: frames(20.0, sysid=sysid, doublet_s=6.0) for sysid in range(1, 5)}
CAUSE = "ZeroDivisionError at test_failures.py:"
Where = Callable[..., bool]


def fail(monkeypatch: pytest.MonkeyPatch, place: str, where: Where = lambda *_: True) -> None:
    """Have a function raise where its arguments say so."""
    real = resolve_name(place)

    def raising(*given: Any, **named: Any) -> Any:
        if where(*given):
            raise ZeroDivisionError("one wrong number")
        return real(*given, **named)

    monkeypatch.setattr(place, raising)


def fly_all(session: Session) -> None:
    """Send all flights to their ends and wait until the tlogs that are written hold them."""
    sent = mixed(*SENT.values())
    for at in range(0, len(sent), 500):
        send(sent[at : at + 500], session.port)
        time.sleep(0.02)
    for sysid, own in SENT.items():
        if session.part("tlog", f"live-{sysid}").exists():
            wait_for_size(session.part("tlog", f"live-{sysid}"), tlog_size(own))


def is_whole(session: Session, sysid: int, name: str) -> bool:
    """Whether a tlog holds every frame that the vehicle sent, and its replay gives the answers."""
    recorded = [frame for _, frame in split((session.folder / f"{name}.tlog").read_bytes())]
    ended = next(each.summary for each in session.ended if each.summary.vehicle.sysid == sysid)
    again = session.again(name)
    return (
        [frame for frame in recorded if frame[5] == sysid] == SENT[sysid]
        and again.estimates == ended.estimates
        and [m.estimates for m in again.manoeuvres] == [m.estimates for m in ended.manoeuvres]
        and len(again.manoeuvres) == 1
    )


ESTIMATING: dict[str, tuple[int, Where]] = {
    "yawid.estimation.bank.Bank.run": (2, lambda bank, _: bank.config.sysid == 2),
    "yawid.manoeuvre.stage.answer": (3, lambda *given: given[2].config.sysid == 3),
    "yawid.runs.live.vehicle_session.summarise": (
        4, lambda pipeline, *_: pipeline.config.sysid == 4 and pipeline.bank is not None,
    ),
}  # fmt: skip


def test_where_the_estimation_of_vehicles_fails_their_tlogs_and_the_other_vehicle_go_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patched:
        for place, (_, where) in ESTIMATING.items():
            fail(patched, place, where)
        with listening(tmp_path, every_vehicle=True) as session:
            fly_all(session)
    ended = dict(zip(SENT, session.ended, strict=True))
    assert ended[1].exit_code in (0, 5)
    assert is_whole(session, 1, "live-1")
    for sysid, _ in ESTIMATING.values():
        recorded = [frame for _, frame in split((tmp_path / f"live-{sysid}.tlog").read_bytes())]
        assert recorded == SENT[sysid]
        [said] = session.lines(f"system {sysid}: the estimation failed because of {CAUSE}")
        assert "one wrong number" in said
        assert session.lines(
            f"system {sysid}: failed in this session: estimation; exit code 70"
        )  # the last line
        assert ended[sysid].exit_code == 70
        of_file = open_run(tmp_path / f"live-{sysid}.mcap").summary
        for summary in (of_file.to_json(), ended[sysid].summary.to_json()):
            assert not summary["verdict"]["usable"]
            assert CAUSE in summary["verdict"]["reasons"][0]["text"]
            assert summary["vehicle"]["sysid"] == sysid
            assert any(CAUSE in text for text in summary["live"]["failed"])
    fail(monkeypatch, "yawid.manoeuvre.stage.answer")
    with pytest.raises(ZeroDivisionError, match="wrong number"):  # what a replay does not confine
        session.again("live-1")


OUTPUTS = {
    "yawid.runs.live.screen_facts.Gatherer.facts": "status",
    "yawid.runs.live.vehicle_session.RerunSink.take": "viewer",
    "yawid.runs.live.publish.values_of": "publishing",
    "yawid.runs.live.loop.RateRequests.tick": "asking for rates",
    "yawid.sinks.mcap.sink.McapSink._write": "mcap",
    "yawid.sinks.terminal.live_page.Page.__rich_console__": "the screen",
    "yawid.sources.link.publisher.Publisher.send_texts": "publishing",
    "yawid.sinks.mcap.sink.McapSink._finish": "mcap",
    "yawid.runs.live.guarded_sink.TlogRecorder._write": "tlog",
}


@pytest.mark.parametrize(
    ("places", "draws"), [([*OUTPUTS][:5], False), ([*OUTPUTS][5:8], True), ([*OUTPUTS][8:], False)]
)
def test_where_outputs_fail_each_is_said_once_the_rest_goes_on_and_the_exit_code_is_6(
    places: list[str], draws: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    failed = {OUTPUTS[place] for place in places}
    shown = Outputs(tmp_path, "live", "rerun+http://127.0.0.1:9/proxy")
    asked = {"publish": ("tap",), "request_hz": 50.0, "draws": draws}
    with monkeypatch.context() as patched:
        for place in places:
            fail(patched, place)
        with listening(tmp_path, outputs=shown, **asked) as session:
            send(SENT[1], session.port)
            session.screen.wait_for("status failed" if "status" in failed else " samples")
            # One of those of the screen fails as it is finished.
            wait_until(lambda: len(session.lines(CAUSE)) >= len(failed) - draws)
            if "tlog" not in failed:
                wait_for_size(session.part("tlog"), tlog_size(SENT[1]))
    [(summary, code)] = session.ended
    assert len(session.lines(CAUSE)) == len(failed), session.screen.getvalue()
    assert "Traceback" not in session.screen.getvalue()
    for name in failed:
        assert re.search(
            f"failed in this session: .*{name}.*; exit code 6", session.screen.getvalue()
        )
    assert (code, set(summary.files)) == (6, {"mcap", "tlog"} - failed)
    assert [CAUSE in text for text in summary.live.failed] == [True] * len(failed)
    assert summary.estimates["els"].updates > 100
    assert "tlog" in failed or is_whole(session, 1, "live")


def test_a_link_whose_thread_fails_ends_the_session_with_a_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls = []
    fail(
        monkeypatch, "yawid.sources.link.udp.UdpTap._put", lambda *_: len(calls) or calls.append(1)
    )
    with listening(tmp_path) as session:
        send(SENT[1], session.port)
        session.screen.wait_for("failed: ZeroDivisionError: one wrong number")
    assert [each.exit_code for each in session.ended] == [6]


def test_what_a_disk_does_to_one_file_is_one_line_and_all_others_go_on_under_a_clock_that_is_set(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first has a full disk under its MCAP, the second under its tlog.

    Of the third's MCAP a synchronisation fails, and the files of the fourth are removed.
    """
    ahead_ns, fsync, syncing = [0], os.fsync, list[str]()
    stamps = Stamps(lambda: time.time_ns() + ahead_ns[0])
    monkeypatch.setattr("yawid.runs.live.loop.Stamps", lambda: stamps)

    def of_a_broken_disk(descriptor: int) -> None:
        name, thread = (
            Path(f"/proc/self/fd/{descriptor}").readlink().name,
            threading.current_thread(),
        )
        syncing.append(thread.name)
        if thread.name == "yawid-disk" and "live-3.mcap" in name:
            raise OSError(errno.EIO, os.strerror(errno.EIO))
        fsync(descriptor)

    monkeypatch.setattr("os.fsync", of_a_broken_disk)
    for name in ("live-1.mcap", "live-2.tlog"):  # it says ENOSPC to every write, as a full disk
        (tmp_path / f"{name}.part").symlink_to("/dev/full")
    forced = Outputs(tmp_path, "live", force=True)
    with listening(tmp_path, outputs=forced, every_vehicle=True) as session:
        early = mixed(*(own[:300] for own in SENT.values()))
        send(early, session.port)
        wait_for_size(session.part("tlog", "live-4"), 1)
        for suffix in ("tlog", "mcap"):
            session.part(suffix, "live-4").unlink()
        for jump_s in (7200, -7200):
            ahead_ns[0] += jump_s * 1_000_000_000
            session.screen.wait_for(f"this machine's clock jumped by {jump_s:+.1f} s")
        for suffix in ("tlog", "mcap"):
            session.screen.wait_for(f"live-4.{suffix}.part has been removed")
        send(mixed(*(own[300:] for own in SENT.values())), session.port)
        session.screen.wait_for("live-3.mcap.part: Input/output error: the session goes on")
        for sysid in (1, 3):
            wait_for_size(session.part("tlog", f"live-{sysid}"), tlog_size(SENT[sysid]))
        assert {*syncing} == {"yawid-disk"}  # for which the loop does not wait
    said = ("No space left", "Input/output error", "has been removed", "clock jumped")
    assert [len(session.lines(text)) for text in said] == [2, 1, 2, 2]
    files = [{"tlog"}, {"mcap"}, {"tlog"}, set()]
    assert [(set(each.summary.files), each.exit_code) for each in session.ended] == [
        (own, 6) for own in files
    ]
    assert [len(each.summary.live.failed) for each in session.ended] == [1, 1, 1, 2]
    assert all(each.summary.estimates["els"].updates > 100 for each in session.ended)
    for sysid in (1, 3):
        assert is_whole(session, sysid, f"live-{sysid}")
    stamped = [us for us, _ in split((tmp_path / "live-1.tlog").read_bytes())]
    assert stamped == sorted(stamped)
    assert stamped[-1] - stamped[0] < 60_000_000
    link = session.ended[0].summary.link
    assert (link.clock_steps, link.reboots) == (0, 0)


@pytest.mark.filterwarnings("ignore:RRD file has no footer")  # a receiver that still runs
def test_a_viewer_that_dies_is_one_line_the_files_are_whole_and_one_that_comes_back_is_shown_more(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("yawid.runs.live.viewer_thread.AGAIN_S", 0.1)
    with (
        viewer("--serve-grpc") as (address, process),
        listening(tmp_path, outputs=Outputs(tmp_path, "live", address)) as session,
    ):
        session.fly(frames(10.0))
        session.screen.wait_for("tracking")
        process.kill()
        process.wait(LEAVE_S)
        sent = frames(5.0, first_s=110.0)
        for at in range(0, len(sent), 25):  # while it looks for the viewer and finds none
            session.fly(sent[at : at + 25])
        session.screen.wait_for("no Rerun viewer")
        port = address.rpartition(":")[2].partition("/")[0]
        again = [VIEWER, "--bind", "127.0.0.1", "--port", port, "--save", str(tmp_path / "got.rrd")]
        with child(again, stderr=subprocess.DEVNULL):
            session.screen.wait_for("the Rerun viewer is back")
            session.fly(frames(5.0, first_s=115.0))
            # It was given the grid again.
            wait_until(lambda: "/input" in recorded(tmp_path / "got.rrd"))
            assert len(session.lines("no Rerun viewer")) == 1
    [(summary, code)] = session.ended
    assert any("no Rerun viewer" in event for event in summary.live.events)
    assert (set(summary.files), code in (0, 5)) == ({"mcap", "tlog"}, True)
    els = summary.estimates["els"]
    assert 0 < summary.live.viewer_skipped < els.held + els.updates
