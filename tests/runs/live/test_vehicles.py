"""Several vehicles on one port, and two senders with one number."""

from __future__ import annotations

import os
import socket
import threading
import time
from dataclasses import asdict, replace
from functools import partial
from itertools import chain
from operator import itemgetter
from pathlib import Path

import psutil
import pytest
from finished_runs import messages
from live_link import CONFIG, frames, listening, send, tlog_size, wait_for_size
from printed import why_invalid
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from yawid.runs.live.overload import Overload
from yawid.runs.live.vehicle_session import LiveSession
from yawid.runs.outputs import Outputs
from yawid.runs.replay import StopFlag, replay
from yawid.sources.link.endpoints import Endpoint
from yawid.sources.link.inbox import Stamps
from yawid.sources.link.udp import UdpTap
from yawid.sources.mavlink.signing import SigningKey
from yawid.sources.open_log import ReadOptions
from yawid.system.processes import cores


def mixed(*vehicles: list[bytes]) -> list[bytes]:
    return list(chain.from_iterable(zip(*vehicles, strict=True)))


def test_each_vehicle_has_its_own_files_and_its_own_estimate(tmp_path: Path):
    one, two = frames(20.0, sysid=1), frames(20.0, sysid=2)
    ground = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
    beat = bytes(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3).pack(ground))
    with listening(tmp_path, every_vehicle=True) as session:
        send([beat, *mixed(one, two), beat], session.port)
        # What 2 sent before it said what it is goes into its tlog, the station's frames into none.
        heard = {1: one, 2: two}
        for sysid, sent in heard.items():
            wait_for_size(session.part("tlog", f"live-{sysid}"), tlog_size(sent))

    ended = {e.summary.vehicle.sysid: e.summary for e in session.ended}
    assert set(ended) == {1, 2}
    assert {p.name for p in tmp_path.iterdir()} == {
        f"live-{sysid}.{suffix}" for sysid in (1, 2) for suffix in ("tlog", "mcap")
    }
    for sysid, summary in ended.items():
        assert summary.link.frames == len(heard[sysid])
        again = replay(
            tmp_path / f"live-{sysid}.tlog",
            asdict(CONFIG),
            Outputs(tmp_path, f"{sysid}"),
            StopFlag(),
        )
        assert again.estimates == summary.estimates
        assert again.estimates["els"].updates > 100
        assert again.link.lost == 0


@pytest.mark.long
def test_vehicles_that_fly_a_doublet_at_once_give_what_their_replays_give_to_the_bit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    sent = {sysid: frames(20.0, sysid=sysid, doublet_s=9.0) for sysid in range(1, 7)}
    at_once, syncing = mixed(*sent.values()), []
    fsync = os.fsync

    def noted(descriptor: int) -> None:
        syncing.append(threading.current_thread().name)
        fsync(descriptor)

    monkeypatch.setattr("os.fsync", noted)
    before = set(threading.enumerate())
    with listening(tmp_path, every_vehicle=True) as session:
        for first in range(0, len(at_once), 500):  # some 100 times as fast as it was flown
            send(at_once[first : first + 500], session.port)
            time.sleep(0.02)
        session.screen.wait_for("6 vehicles, ")
        session.screen.wait_for(": 6 tracking")
        children = [each.cmdline() for each in psutil.Process().children()]
        wait_for_size(session.part("tlog", "live-6"), tlog_size(sent[6]))
        own = {each.name for each in set(threading.enumerate()) - before}
        in_the_loop = set(syncing) - {"yawid-disk"}

    assert sum("yawid.system.child" in each for each in children) == min(cores(), 4)
    threads = {name for name in own if name.startswith("yawid-")}
    assert threads == {"yawid-tap", "yawid-manoeuvres", "yawid-disk", "yawid-console"}
    assert (in_the_loop, "yawid-disk" in syncing) == (set(), True)
    assert [each.summary.vehicle.sysid for each in session.ended] == [*sent]
    for summary in (each.summary for each in session.ended):
        name = f"live-{summary.vehicle.sysid}"
        again = replay(
            tmp_path / f"{name}.tlog",
            asdict(CONFIG),
            Outputs(tmp_path, f"{name}-again"),
            StopFlag(),
        )
        assert (summary.link.lost, sum(summary.live.dropped.values())) == (0, 0)
        told, own_told = summary.to_json(), again.to_json()
        assert why_invalid("live", told) == ""
        assert len(told["manoeuvres"]) == 1
        for key in ("estimates", "manoeuvres", "flight", "verdict"):
            assert told[key] == own_told[key]
        live, replayed = (
            sorted(messages(tmp_path / f"{name}{end}.mcap"), key=itemgetter(0))
            for end in ("", "-again")
        )
        assert live == replayed


def test_what_has_no_room_is_counted_and_said_and_nothing_else_is_missing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr("yawid.runs.live.loop.UdpTap", partial(UdpTap, queue_size=300))
    sent = frames(10.0)
    with listening(tmp_path) as session:
        send(sent, session.port)
        session.screen.wait_for("datagrams were dropped so far")
    [ended] = session.ended
    dropped = sum(ended.summary.live.dropped.values())
    assert dropped > 0
    assert ended.summary.link.frames + dropped == len(sent)
    assert any("in no file and no estimate" in line for line in ended.summary.live.events)
    assert (
        f"some datagrams were lost on this machine: {dropped} dropped" in session.screen.getvalue()
    )


def test_a_stop_skips_what_waits_in_the_tlog_and_in_the_estimates_alike(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    sent, is_late, may_go_on = frames(20.0), threading.Event(), threading.Event()
    estimate = LiveSession.estimate

    def slow(session: LiveSession, data: bytes) -> None:
        estimate(session, data)
        if session.pipeline.samples > 100:
            is_late.set()
            may_go_on.wait(60.0)

    monkeypatch.setattr(LiveSession, "estimate", slow)
    with listening(tmp_path) as session:
        send(sent[:1500], session.port)
        assert is_late.wait(60.0)
        send(sent[1500:], session.port)
        time.sleep(1.3)
        session.stop.is_set = True
        may_go_on.set()
    [ended] = session.ended
    skipped = ended.summary.live.dropped["at_the_stop"]
    assert skipped >= len(sent) - 1500
    assert ended.summary.link.frames == len(sent) - skipped
    [line] = [line for line in ended.summary.live.events if line.startswith("stopped while")]
    left_bytes = sum(map(len, sent[len(sent) - skipped :]))
    assert f"{skipped} datagrams of {left_bytes} bytes" in line
    assert (tmp_path / "live.tlog").stat().st_size == tlog_size(sent[: len(sent) - skipped])
    again = replay(tmp_path / "live.tlog", asdict(CONFIG), Outputs(tmp_path, "again"), StopFlag())
    assert again.estimates == ended.summary.estimates
    assert again.estimates["els"].updates > 50


def test_estimates_that_fall_behind_the_link_are_said_and_that_they_have_caught_up():
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


def test_who_is_no_vehicle_fills_no_tlog_and_made_up_vehicles_open_no_more_than_may_be(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """One station's frames would be written once for each vehicle; anybody claims to be many."""
    vehicle, ground = frames(4.0, sysid=9), mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
    chatter = [bytes(mavlink.MAVLink_ping_message(i, i, 0, 0).pack(ground)) for i in range(100)]
    beat = mavlink.MAVLink_heartbeat_message(1, 3, 0, 0, 4, 3)
    made_up = [
        bytes(beat.pack(mavlink.MAVLink(None, srcSystem=sysid, srcComponent=1)))
        for sysid in range(10, 60)
    ]
    monkeypatch.setattr("yawid.runs.live.vehicles.MOST_VEHICLES", 3)
    with listening(tmp_path, every_vehicle=True) as session:
        send([*vehicle, *chatter, *made_up, *chatter], session.port)
        session.screen.wait_for(
            "system 12: no session is opened, as there are 3 already: without --signing-key-file"
        )
        wait_for_size(session.part("tlog", "live-9"), tlog_size(vehicle))

    assert session.screen.getvalue().count("no session is opened, as there are") == 1
    sizes = {path.stem: path.stat().st_size for path in tmp_path.glob("*.tlog")}
    assert sizes == {
        "live-9": tlog_size(vehicle),
        "live-10": tlog_size(made_up[:1]),
        "live-11": tlog_size(made_up[1:2]),
    }


def test_one_of_several_vehicles_can_be_chosen(tmp_path: Path):
    sent = mixed(frames(20.0, sysid=1), frames(20.0, sysid=2))
    with listening(tmp_path, replace(CONFIG, sysid=2)) as session:
        send(sent, session.port)
        wait_for_size(session.part("tlog"), tlog_size(sent))

    assert session.ended[0].summary.vehicle.sysid == 2


def test_a_second_vehicle_that_is_not_estimated_is_said_one_time(tmp_path: Path):
    with listening(tmp_path) as session:
        send(mixed(frames(10.0, sysid=1), frames(10.0, sysid=2)), session.port)
        session.screen.wait_for("tracking")

    assert (
        session.screen.getvalue().count("system 2 is received too, but system 1 is estimated") == 1
    )


def test_a_link_without_any_vehicle_is_one_summary_that_says_so(tmp_path: Path):
    with listening(tmp_path, every_vehicle=True) as session:
        pass

    assert [e.exit_code for e in session.ended] == [3]


def test_a_vehicle_too_slow_for_the_rate_asked_for_does_not_stop_the_others(tmp_path: Path):
    quick, slow = frames(20.0, sysid=1), frames(20.0, sysid=2, hz=5)
    with listening(tmp_path, every_vehicle=True) as session:
        send([*slow, *quick], session.port)
        session.screen.wait_for("system 2: ")
        session.screen.wait_for("no longer estimated")
        session.screen.wait_for("tracking")

    assert [e.summary.vehicle.sysid for e in session.ended] == [1]


def test_a_second_address_with_the_same_number_is_noticed_one_time(tmp_path: Path):
    sent = frames(10.0)
    with (
        listening(tmp_path) as session,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as forger,
    ):
        for i in range(0, len(sent), 2):
            send(sent[i : i + 1], session.port, vehicle)
            send(sent[i + 1 : i + 2], session.port, forger)
        session.screen.wait_for("system 1 is received from two addresses")
        ports = {s.getsockname()[1] for s in (vehicle, forger)}
    said = [text for text in session.screen.getvalue().splitlines() if "two addresses" in text]
    assert len(said) == 1
    assert all(f"127.0.0.1:{port}" in said[0] for port in ports)


def signed_again(sent: list[bytes], key: bytes) -> list[bytes]:
    """The same messages of the same sender, signed."""
    link = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    link.signing.secret_key, link.signing.timestamp, link.signing.sign_outgoing = key, 1, True
    reader, signed = mavlink.MAVLink(None), []
    for frame in sent:
        message = reader.decode(bytearray(frame))
        link.seq = message.get_seq()
        signed.append(bytes(message.pack(link)))
    return signed


def test_with_a_key_an_unsigned_heartbeat_opens_no_session(tmp_path: Path):
    key, stranger = bytes(range(32)), frames(4.0, sysid=2)
    own = signed_again(frames(20.0), key)
    forged = signed_again(frames(4.0), bytes(32))  # by another key
    with listening(
        tmp_path, read_options=ReadOptions(key=SigningKey(key)), every_vehicle=True
    ) as session:
        send([*forged, *stranger, *own, *stranger], session.port)
        session.screen.wait_for("system 2: its HEARTBEAT is not signed")
        wait_for_size(session.part("tlog", "live-1"), tlog_size([*forged, *own]))

    [ended] = session.ended
    assert ended.summary.vehicle.sysid == 1
    assert ended.summary.link.unsigned_rejected == len(forged)
    assert {path.name for path in tmp_path.iterdir()} == {"live-1.tlog", "live-1.mcap"}
    assert session.screen.getvalue().count("system 2: its HEARTBEAT is not signed") == 1


def test_with_a_key_rates_are_asked_for_in_signed_frames(tmp_path: Path):
    key = bytes(range(32))
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle,
        listening(
            tmp_path, read_options=ReadOptions(key=SigningKey(key)), request_hz=50.0
        ) as session,
    ):
        vehicle.settimeout(60.0)
        send(signed_again(frames(1.0), key), session.port, vehicle)
        asked = vehicle.recv(300)
    strict = mavlink.MAVLink(None)
    strict.signing.secret_key, strict.signing.timestamp = key, 1
    assert strict.decode(bytearray(asked)).get_type() == "COMMAND_LONG"
