"""A live session is a tlog being written: its replay gives the same bits, whatever the link is."""

from __future__ import annotations

import json
import math
import os
import socket
import sys
from dataclasses import replace
from operator import itemgetter
from pathlib import Path

import pytest
from checks.children import free_udp_port
from finished_runs import messages
from flights.surgery import edited, split
from live_link import CONFIG, Session, frames, listening, send, tlog_size, wait_for_size
from places import REPLAY_LOGS
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from yawid.cli.main import main
from yawid.config.run import RunConfig
from yawid.errors import ConfigError
from yawid.estimation import armax
from yawid.estimation.machine import kept
from yawid.estimation.machine.runner import RUNNER, Runner
from yawid.runs.live import loop
from yawid.runs.live.vehicles import records
from yawid.runs.outputs import Outputs
from yawid.sources.mavlink.signing import SigningKey
from yawid.sources.open_log import ReadOptions

GAPS = [f for _, f in split((REPLAY_LOGS / "c172p_gaps" / "log.tlog").read_bytes())]
"""Four manoeuvres of a Cessna, of which three end before the flight does."""
KEY = bytes(range(32))


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Session:
    """The session of that flight, which answers while it runs and sends not one byte."""
    folder, before_s = tmp_path_factory.mktemp("flown"), sys.getswitchinterval()
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle,
        listening(folder, RunConfig(), Outputs(folder, "live", "save")) as session,
    ):
        session.fly(GAPS, vehicle)
        session.screen.wait_for("manoeuvre 3 (")
        assert sys.getswitchinterval() == pytest.approx(0.001)
        vehicle.settimeout(0.0)
        with pytest.raises(BlockingIOError):
            vehicle.recv(1)
    assert sys.getswitchinterval() == before_s
    return session


def test_its_replay_gives_the_same_bits_and_the_same_manoeuvres(flown: Session) -> None:
    [(summary, code)] = flown.ended
    again = flown.again()

    assert summary.estimates == again.estimates
    assert len(summary.manoeuvres) == 4
    found, own = (run.to_json() for run in (summary, again))
    for key in ("manoeuvres", "flight", "verdict", "ordinary"):
        assert found[key] == own[key]
    # Topic by topic: a manoeuvre has the log_time of its last sample.
    live, replayed = (
        sorted(messages(flown.folder / f"{name}.mcap"), key=itemgetter(0))
        for name in ("live", "live-again")
    )
    assert [topic for topic, *_ in live].count("/yawid/manoeuvre") == 4
    assert live == replayed
    assert code == again.exit_code == 0
    assert set(summary.files) == {"mcap", "rrd", "tlog"}
    assert (flown.folder / "live.rrd").stat().st_size > 10_000
    assert (summary.link.frames, summary.live.dropped["queue"]) == (len(GAPS), 0)


def to_two_digits(value: float, std: float) -> str:
    digits = 1 - math.floor(math.log10(std))
    return f"{value:.{digits}f} ± {std:.{digits}f}"


def test_a_line_is_said_as_a_manoeuvre_ends_and_stands_in_the_summary(flown: Session) -> None:
    [(summary, _)] = flown.ended
    roll = summary.manoeuvres[0].dutch_roll
    told = [line for line in summary.live.events if line.startswith("manoeuvre ")]
    assert told[0] == (
        "manoeuvre 1 (34 to 60 s, FBWA, 50.9 m/s): "
        f"wn {to_two_digits(roll.wn_rad_s, roll.wn_std)} rad/s, "
        f"zeta {to_two_digits(roll.zeta, roll.zeta_std)}"
    )
    assert [line.split(" ")[1] for line in told] == ["1", "2", "3", "4"]
    assert [len(flown.lines(line)) for line in told] == [1] * 4


@pytest.mark.skipif(not hasattr(os, "openpty"), reason="no pseudo terminals here")
def test_a_serial_line_is_recorded_as_a_socket_is_and_a_manoeuvre_may_be_refused(
    tmp_path: Path,
) -> None:
    vehicle, line = os.openpty()
    sent, slow = frames(20.0), replace(CONFIG, rate=4.0)
    with listening(tmp_path, slow, endpoint=f"{os.ttyname(line)},57600") as session:
        for frame in sent:
            os.write(vehicle, frame)
        wait_for_size(session.part("tlog"), tlog_size(sent))
    for descriptor in (vehicle, line):
        os.close(descriptor)
    [(summary, code)] = session.ended

    assert summary.link.frames == len(sent)
    assert session.again().estimates == summary.estimates
    [found] = summary.manoeuvres
    fatal = [reason.id for reason in found.verdict.reasons if reason.weight == "fatal"]
    [told] = session.lines("manoeuvre 1 (")
    assert told.endswith(f": not usable: {fatal[0]}")
    assert code == summary.exit_code != 0


def test_a_session_changes_over_to_compiled_code_with_the_bits_of_its_replay(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    runner, found = Runner(), kept.find
    monkeypatch.setattr("yawid.estimation.machine.runner.LOOK_S", 0.0)
    monkeypatch.setattr(armax, "RUNNER", runner)
    is_made, behind = [False], list[bool]()
    monkeypatch.setattr(kept, "find", lambda name: found(name) if is_made[0] else None)
    monkeypatch.setattr(loop, "RUNNER", runner)
    monkeypatch.setattr(runner, "compile_behind", lambda: behind.append(True))
    with listening(tmp_path) as session:
        session.fly(frames(15.0))
        session.screen.wait_for("tracking")
        assert not runner.is_compiled()
        is_made[0] = True
        session.fly(frames(10.0, first_s=115.0))
    assert behind == [True]
    assert runner.is_compiled()

    monkeypatch.setattr(armax, "RUNNER", RUNNER)
    session.again()
    assert messages(tmp_path / "live.mcap") == messages(tmp_path / "live-again.mcap")


@pytest.mark.parametrize(("key", "publish"), [(None, ()), (KEY, ("tap",))], ids=("plain", "signed"))
def test_rates_are_asked_in_one_sequence_with_what_is_published_and_signed_where_there_is_a_key(
    key: bytes | None, publish: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("yawid.sources.link.rate_requests.WINDOW_S", 0.5)
    own = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    strict = mavlink.MAVLink(None)  # it refuses what is not newer than the frame before
    for link in (own, strict) if key else ():
        link.signing.secret_key, link.signing.timestamp = key, 1
        link.signing.sign_outgoing = True
    options = {"publish": publish, "request_hz": 50.0}
    options["read_options"] = ReadOptions(key=key and SigningKey(key))
    sent = [frame for _, frame in edited([(0, f) for f in frames(6.0)], key=key)]
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle,
        listening(tmp_path, **options) as session,
    ):
        vehicle.settimeout(60.0)
        send(sent[:100], session.port, vehicle)
        got = [strict.decode(bytearray(vehicle.recv(300))) for _ in range(5 if publish else 1)]
        ack = mavlink.MAVLink_command_ack_message(511, 0)
        own.signing.timestamp = 10**14
        vehicle.sendto(bytes(ack.pack(own)), ("127.0.0.1", session.port))
        send(sent[100:], session.port, vehicle)
        session.screen.wait_for("Hz of the 50 asked for")

    asked = [m for m in got if m.get_type() == "COMMAND_LONG"]
    assert {(m.target_system, m.command) for m in asked} == {(1, 511)}
    assert [m.get_seq() for m in got] == [*range(len(got))]
    assert ("HEARTBEAT" in {m.get_type() for m in got}) is bool(publish)
    assert {m.get_srcComponent() for m in got} == {194}
    rates = session.ended[0].summary.live.rates
    assert {entry["asked_hz"] for entry in rates.values()} == {50.0}
    assert "accepted" in {entry.get("answer") for entry in rates.values()}  # of the last asked
    assert all(entry["achieved_hz"] >= 0.0 for entry in rates.values())


def test_a_rate_that_the_link_does_not_deliver_ends_the_session_and_keeps_the_recording(
    tmp_path: Path,
) -> None:
    sent = frames(20.0)
    with listening(tmp_path, replace(CONFIG, rate=90.0)) as session:
        send(sent, session.port)
        wait_for_size(tmp_path / "live.tlog", 1)
    assert isinstance(session.refused, ConfigError)
    assert "use --rate 50 or less" in str(session.refused)
    assert str(tmp_path / "live.tlog") in str(session.refused)
    kept_frames = [record[8:] for record in records((tmp_path / "live.tlog").read_bytes())]
    assert len(kept_frames) > 500  # more than the five seconds that decide the rate
    assert kept_frames == sent[: len(kept_frames)]


@pytest.mark.parametrize("vehicles", [[], ["--sysid", "all"]])
def test_a_link_nobody_sends_on_has_no_vehicle_and_leaves_no_file(
    vehicles: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = ["--seconds", "0.2", "--json", "--out", str(tmp_path), *vehicles]
    code = main(["live", f"udpin:127.0.0.1:{free_udp_port()}", *options])

    [line] = capsys.readouterr().out.splitlines()
    assert (code, json.loads(line)["verdict"]["reasons"][0]["id"]) == (3, "no_vehicle")
    assert list(tmp_path.iterdir()) == []
