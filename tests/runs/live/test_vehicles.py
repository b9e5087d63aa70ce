"""Several vehicles on one port, two senders with one number, and more than can be estimated."""

from __future__ import annotations

import socket
import threading
import time
from dataclasses import replace
from functools import partial
from operator import itemgetter
from pathlib import Path

import pytest
from finished_runs import messages
from flights.surgery import edited
from live_link import BEAT, CONFIG, GROUND, frames, listening, mixed, send, tlog_size, wait_for_size
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from yawid.runs.live.overload import Overload
from yawid.runs.live.vehicle_session import LiveSession
from yawid.sources.link.endpoints import Endpoint
from yawid.sources.link.inbox import Stamps
from yawid.sources.link.udp import UdpTap
from yawid.sources.mavlink.signing import SigningKey
from yawid.sources.open_log import ReadOptions


def test_each_vehicle_has_its_own_files_and_answers_and_who_is_none_or_one_too_many_has_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One station's frames would be written once for each vehicle; anybody claims to be many."""
    monkeypatch.setattr("yawid.runs.live.vehicles.MOST_VEHICLES", 4)
    # The third's messages are too slow for the rate asked for.
    sent = {1: frames(21.0), 2: frames(22.0, sysid=2), 3: frames(20.0, sysid=3, hz=5)}
    chatter = [bytes(mavlink.MAVLink_ping_message(i, i, 0, 0).pack(GROUND)) for i in range(100)]
    beat = mavlink.MAVLink_heartbeat_message(1, 3, 0, 0, 4, 3)
    made_up = [
        bytes(beat.pack(mavlink.MAVLink(None, srcSystem=sysid, srcComponent=1)))
        for sysid in range(10, 60)
    ]
    with listening(tmp_path, every_vehicle=True) as session:
        send([BEAT, *sent[3], *mixed(sent[1], sent[2]), BEAT], session.port)
        send([*sent[2][len(sent[1]) :], *chatter, *made_up, *chatter], session.port)
        session.screen.wait_for(
            "system 11: no session is opened, as there are 4 already: without --signing-key-file"
        )
        session.screen.wait_for("no longer estimated")
        for sysid in (1, 2):  # also what a vehicle sent before it said what it is
            wait_for_size(session.part("tlog", f"live-{sysid}"), tlog_size(sent[sysid]))

    assert len(session.lines("no session is opened, as there are")) == 1
    assert len(session.lines("system 3: ")) == len(session.lines("no longer estimated")) == 1
    sizes = {path.stem: path.stat().st_size for path in tmp_path.glob("*.tlog")}
    assert sizes.pop("live-3") <= tlog_size(sent[3])
    assert sizes == {f"live-{sysid}": tlog_size(sent[sysid]) for sysid in (1, 2)} | {
        "live-10": tlog_size(made_up[:1])
    }
    whole = {f"live-{sysid}.{suffix}" for sysid in (1, 2, 10) for suffix in ("tlog", "mcap")}
    assert {path.name for path in tmp_path.iterdir()} == {
        *whole, "live-3.tlog", "live-3.mcap.part"
    }  # fmt: skip
    ended = {each.summary.vehicle.sysid: each.summary for each in session.ended[:2]}
    assert list(ended) == [1, 2]
    for sysid, summary in ended.items():
        again = session.again(f"live-{sysid}")
        assert summary.link.frames == len(sent[sysid])
        assert again.link.lost == 0
        assert again.estimates == summary.estimates
        assert again.estimates["els"].updates > 100
        found, own = (run.to_json() for run in (summary, again))
        assert (found["manoeuvres"], found["flight"]) == (own["manoeuvres"], own["flight"])
        live, replayed = (
            sorted(messages(tmp_path / f"live-{sysid}{end}.mcap"), key=itemgetter(0))
            for end in ("", "-again")
        )
        assert live == replayed
        [one] = summary.manoeuvres
        said = f"system {sysid}: manoeuvre 1 ({one.from_s:.0f} to {one.to_s:.0f} s, "
        assert len(session.lines(said)) == 1
    one, two = (summary.manoeuvres[0] for summary in ended.values())
    assert (one.duration_s, one.dutch_roll) != (two.duration_s, two.dutch_roll)


@pytest.mark.parametrize("sysid", [None, 2])
def test_one_of_several_vehicles_is_chosen_or_the_others_are_said_once_and_so_is_a_second_address(
    sysid: int | None, tmp_path: Path
) -> None:
    with (
        listening(tmp_path, replace(CONFIG, sysid=sysid)) as session,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as forger,
    ):
        sent = mixed(frames(10.0), frames(10.0, sysid=2))
        for i in range(0, len(sent), 4):
            send(sent[i : i + 2], session.port, vehicle)
            send(sent[i + 2 : i + 4], session.port, forger)
        session.screen.wait_for("tracking")
        session.screen.wait_for(f"system {sysid or 1} is received from two addresses")
        ports = {s.getsockname()[1] for s in (vehicle, forger)}

    assert [each.summary.vehicle.sysid for each in session.ended] == [sysid or 1]
    others = session.lines("system 2 is received too, but system 1 is estimated")
    assert len(others) == (sysid is None)
    [said] = session.lines(f"system {sysid or 1} is received from two addresses")
    assert all(f"127.0.0.1:{port}" in said for port in ports)


def test_with_a_key_an_unsigned_heartbeat_opens_no_session(tmp_path: Path) -> None:
    key, stranger = bytes(range(32)), frames(4.0, sysid=2)
    own, forged = (
        [frame for _, frame in edited([(0, each) for each in frames(seconds)], key=by)]
        for seconds, by in ((10.0, key), (4.0, bytes(32)))
    )
    with listening(
        tmp_path, read_options=ReadOptions(key=SigningKey(key)), every_vehicle=True
    ) as session:
        send([*forged, *stranger, *own, *stranger], session.port)
        session.screen.wait_for("system 2: its HEARTBEAT is not signed")
        wait_for_size(session.part("tlog", "live-1"), tlog_size([*forged, *own]))

    [(summary, _)] = session.ended
    assert summary.vehicle.sysid == 1
    assert summary.link.unsigned_rejected == len(forged)
    assert {path.name for path in tmp_path.iterdir()} == {"live-1.tlog", "live-1.mcap"}
    assert len(session.lines("system 2: its HEARTBEAT is not signed")) == 1


def test_what_has_no_room_and_what_a_stop_skips_is_counted_and_in_no_file_and_no_estimate(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sent, is_late, may_go_on = frames(20.0), threading.Event(), threading.Event()
    estimate = LiveSession.estimate

    def slow(session: LiveSession, data: bytes) -> None:
        estimate(session, data)
        if session.pipeline.samples > 100:
            is_late.set()
            may_go_on.wait(60.0)

    monkeypatch.setattr(LiveSession, "estimate", slow)
    monkeypatch.setattr("yawid.runs.live.loop.UdpTap", partial(UdpTap, queue_size=300))
    with listening(tmp_path) as session:
        for first in range(0, 400, 100):  # no more than the queue holds, on a busy machine too
            session.fly(sent[first : first + 100])
        for first in range(400, 1500, 100):
            send(sent[first : first + 100], session.port)
            time.sleep(0.02)
        assert is_late.wait(60.0)
        send(sent[1500:], session.port)
        time.sleep(1.3)
        session.stop.is_set = True
        may_go_on.set()
    [(summary, _)] = session.ended
    dropped, kept = summary.live.dropped, summary.link.frames
    assert dropped["queue"] > 0
    assert dropped["at_the_stop"] > 0
    assert kept + sum(dropped.values()) == len(sent)
    left_bytes = sum(map(len, sent[kept : kept + dropped["at_the_stop"]]))
    [line] = session.lines("stopped while")
    assert f"{dropped['at_the_stop']} datagrams of {left_bytes} bytes" in line
    assert any("in no file and no estimate" in line for line in summary.live.events)
    lost = f"some datagrams were lost on this machine: {dropped['queue']} dropped"
    assert len(session.lines(lost)) == len(session.lines("datagrams were dropped so far")) == 1
    assert (tmp_path / "live.tlog").stat().st_size == tlog_size(sent[:kept])
    again = session.again()
    assert again.estimates == summary.estimates
    assert again.estimates["els"].updates > 50


def test_estimates_that_fall_behind_the_link_are_said_and_that_they_have_caught_up() -> None:
    ahead_ns = [0]
    stamps = Stamps(steady_ns=lambda: time.monotonic_ns() + ahead_ns[0])
    with UdpTap(Endpoint("127.0.0.1", 0), stamps=stamps) as tap:
        overload = Overload(tap)
        send(frames(1.0)[:2], tap.address[1])
        assert tap.inbox.arrived.wait(60.0)
        tap.read(1.0)
        assert list(overload.lines()) == []
        came_us = stamps.now()
        tap.inbox.put([(came_us, b"", ("127.0.0.1", 1))])
        assert tap.reached_us() == came_us  # until then a vehicle is not called silent
        ahead_ns[0] = 5_000_000_000
        [line] = overload.lines()
        assert "5 s behind the link: 1 datagrams wait" in line
        assert list(overload.lines()) == []
        while len(tap.inbox):
            tap.read(1.0)
        assert list(overload.lines()) == ["the estimates have caught up with the link"]
