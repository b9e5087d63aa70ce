"""A live session is a tlog being written: its replay gives the same estimates, bit for bit."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import threading
from dataclasses import asdict, replace
from pathlib import Path

import pytest
from checks.children import child, free_udp_port
from finished_runs import messages
from flights import send_tlog
from flights.flight import FlightPlan
from flights.fly import flight_of
from flights.telemetry import Link, telemetry
from live_link import (
    CONFIG,
    Screen,
    frames,
    listening,
    send,
    tlog_size,
    wait_for_size,
)
from printed import printed
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from yawid.cli.main import main
from yawid.config.run import RunConfig
from yawid.errors import ConfigError, SourceError
from yawid.runs.live import Console, LiveOptions, live
from yawid.runs.live.vehicles import records
from yawid.runs.outputs import Outputs
from yawid.runs.replay import StopFlag, replay


def test_replaying_the_recorded_session_gives_the_same_bits(tmp_path: Path):
    link = Link(attitude_hz=50.0, servo_hz=50.0)
    sent = list(telemetry(link, flight_of(FlightPlan(seconds=25.0), link)))
    config = RunConfig(rate=10.0)
    with listening(tmp_path, config, Outputs(tmp_path, "live", "save")) as session:
        send_tlog.send(sent, ("127.0.0.1", session.port), 25.0)
        wait_for_size(session.part("tlog"), tlog_size([frame for _, frame in sent]))

    [(summary, _)] = session.ended
    again = replay(tmp_path / "live.tlog", asdict(config), Outputs(tmp_path, "again"), StopFlag())

    assert summary.estimates == again.estimates
    assert summary.estimates["els"].updates > 100
    assert summary.link.frames == len(sent)
    assert messages(tmp_path / "live.mcap") == messages(tmp_path / "again.mcap")
    assert (tmp_path / "live.rrd").stat().st_size > 10_000
    assert set(summary.files) == {"mcap", "rrd", "tlog"}
    assert summary.live.dropped["queue"] == 0


@pytest.mark.skipif(not hasattr(os, "openpty"), reason="no pseudo terminals here")
def test_a_serial_line_is_recorded_and_estimated_as_a_socket_is(tmp_path: Path):
    vehicle, line = os.openpty()
    sent = frames(20.0)
    with listening(tmp_path, endpoint=f"{os.ttyname(line)},57600") as session:
        for frame in sent:
            os.write(vehicle, frame)
        wait_for_size(session.part("tlog"), tlog_size(sent))
    for descriptor in (vehicle, line):
        os.close(descriptor)
    summary = session.ended[0].summary
    again = replay(tmp_path / "live.tlog", asdict(CONFIG), Outputs(tmp_path, "again"), StopFlag())

    assert summary.link.frames == len(sent)
    assert summary.estimates["els"].updates > 100
    assert again.estimates == summary.estimates


def test_a_session_is_passive_not_one_byte_comes_back(tmp_path: Path):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle:
        with listening(tmp_path) as session:
            sent = frames(8.0)
            send(sent, session.port, vehicle)
            wait_for_size(session.part("tlog"), tlog_size(sent))
        vehicle.settimeout(0.0)
        with pytest.raises(BlockingIOError):
            vehicle.recv(1)
    assert session.ended[0].summary.estimates


def test_rates_are_asked_of_the_vehicle_and_what_came_is_in_the_summary(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr("yawid.sources.link.rate_requests.WINDOW_S", 0.5)
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle,
        listening(tmp_path, request_hz=50.0) as session,
    ):
        vehicle.settimeout(60.0)
        send(frames(1.0), session.port, vehicle)
        asked = mavlink.MAVLink(None).decode(bytearray(vehicle.recv(300)))
        ack = mavlink.MAVLink_command_ack_message(511, 0)
        own = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
        vehicle.sendto(bytes(ack.pack(own)), ("127.0.0.1", session.port))
        send(frames(5.0, first_s=101.0), session.port, vehicle)
        session.screen.wait_for("Hz of the 50 asked for")
    rates = session.ended[0].summary.live.rates
    assert (asked.get_type(), asked.target_system, asked.command) == ("COMMAND_LONG", 1, 511)
    assert {entry["asked_hz"] for entry in rates.values()} == {50.0}
    assert rates["ATTITUDE"]["answer"] == "accepted"
    assert all(entry["achieved_hz"] >= 0.0 for entry in rates.values())


@pytest.mark.parametrize(
    "number", [signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.long)]
)
def test_a_signal_ends_a_session_with_every_file_finished(number: int, tmp_path: Path):
    port = free_udp_port()
    arguments = [f"udpin:127.0.0.1:{port}", "--out", str(tmp_path), "--json"]
    with child(
        [sys.executable, "-m", "yawid", "live", *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | {"PYTHONUNBUFFERED": "1"},
    ) as process:
        assert "listening" in process.stderr.readline()
        sent = frames(3.0)
        send(sent, port)
        wait_for_size(wait_for_part(tmp_path), tlog_size(sent))
        process.send_signal(number)
        out, err = process.communicate(timeout=60)

    assert process.returncode in (0, 5), err
    assert out.count("\n") == 1
    summary = printed("live", out)
    assert (process.returncode == 0) is summary["verdict"]["usable"]
    assert summary["link"]["frames"] == len(sent)
    assert {path.suffix for path in tmp_path.iterdir()} == {".tlog", ".mcap"}


def wait_for_part(folder: Path) -> Path:
    """The tlog of a session that names its files itself."""
    for _ in range(300):
        if parts := list(folder.glob("*.tlog.part")):
            return parts[0]
        threading.Event().wait(0.1)
    raise AssertionError("no tlog was begun")


def test_a_link_nobody_sends_on_has_no_vehicle_and_leaves_no_file(tmp_path: Path):
    options = LiveOptions(f"udpin:127.0.0.1:{free_udp_port()}", seconds=0.3)
    screen = Screen()

    [ended] = live(options, RunConfig(), Outputs(tmp_path, "live"), StopFlag(), Console(screen))

    assert ended.exit_code == 3
    assert ended.summary.files == {}
    assert list(tmp_path.iterdir()) == []


def test_no_record_writes_no_tlog(tmp_path: Path):
    with listening(tmp_path, outputs=Outputs(tmp_path, "live", record=False)) as session:
        send(frames(2.0), session.port)
        wait_for_size(session.part("mcap"), 1)

    assert [path.name for path in tmp_path.iterdir()] == ["live.mcap"]


def test_what_was_still_queued_when_the_session_ends_is_recorded_too(tmp_path: Path):
    sent = frames(10.0)
    with listening(tmp_path) as session:
        send(sent, session.port)

    assert session.ended[0].summary.link.frames == len(sent)


def test_the_line_says_rate_samples_modes_and_losses(tmp_path: Path):
    with listening(tmp_path) as session:
        sent = frames(20.0)
        send(sent[:300] + sent[320:], session.port)
        session.screen.wait_for("tracking, ")
    line = next(text for text in session.screen.getvalue().splitlines() if "tracking" in text)
    for word in ("msg/s", "lost 20, dropped 0", "samples", "wn", "zeta"):
        assert word in line


def test_a_rate_that_the_link_does_not_deliver_ends_the_session_and_keeps_the_recording(
    tmp_path: Path,
):
    sent, port, screen = frames(20.0), free_udp_port(), Screen()
    options = LiveOptions(f"udpin:127.0.0.1:{port}", seconds=600.0)
    config = replace(CONFIG, rate=90.0)

    def play() -> None:
        screen.wait_for("listening")
        send(sent, port)

    sender = threading.Thread(target=play, daemon=True)
    sender.start()
    with pytest.raises(ConfigError, match="use --rate 50 or less") as refused:
        live(options, config, Outputs(tmp_path, "live"), StopFlag(), Console(screen))
    sender.join(60.0)

    assert str(tmp_path / "live.tlog") in str(refused.value)
    recorded = (tmp_path / "live.tlog").read_bytes()
    frames_recorded = [record[8:] for record in records(recorded)]
    assert len(frames_recorded) > 500  # more than the five seconds that decide the rate
    assert frames_recorded == sent[: len(frames_recorded)]


def test_a_folder_that_cannot_be_made_is_refused_before_the_socket_opens(tmp_path: Path):
    (tmp_path / "file").write_text("", encoding="utf-8")
    options = LiveOptions(f"udpin:127.0.0.1:{free_udp_port()}", seconds=5.0)
    with pytest.raises(Exception, match="cannot write"):
        live(options, CONFIG, Outputs(tmp_path / "file", "x"), StopFlag(), Console(Screen()))


def test_a_port_in_use_is_refused_and_leaves_nothing(tmp_path: Path):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        options = LiveOptions(f"udpin:127.0.0.1:{taken.getsockname()[1]}")
        with pytest.raises(SourceError, match="in use"):
            live(options, CONFIG, Outputs(tmp_path, "x"), StopFlag(), Console(Screen()))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        ({"endpoint": "udpout:127.0.0.1:14550"}, "passive"),
        ({"endpoint": "udpin:127.0.0.1:1", "seconds": 0.0}, "--seconds"),
        ({"endpoint": "udpin:127.0.0.1:1", "request_hz": -1.0}, "--request-rates"),
        ({"endpoint": "udpin:127.0.0.1:1", "request_hz": 5.0, "every_vehicle": True}, "--sysid N"),
    ],
)
def test_what_cannot_be_asked_is_refused_in_one_line(options: dict[str, object], reason: str):
    with pytest.raises(ConfigError, match=reason):
        LiveOptions(**options)  # type: ignore[arg-type] # each of its own type


def test_silence_is_said_once_and_so_is_the_return(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("yawid.runs.live.loop.SILENT_US", 1_000_000)
    with listening(tmp_path) as session:
        send(frames(1.0), session.port)
        session.screen.wait_for("no data for 1 s")
        send(frames(1.0, first_s=200.0), session.port)
        session.screen.wait_for("the link is back")
    said = session.screen.getvalue()
    assert said.count("no data for") == said.count("the link is back") == 1


def test_the_mcap_of_a_session_that_goes_on_is_replayed_as_far_as_it_is(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    with listening(tmp_path) as session:
        send(frames(20.0), session.port)
        session.screen.wait_for("tracking")
        wait_for_size(session.part("mcap"), 20_000)
        (tmp_path / "torn.mcap").write_bytes(session.part("mcap").read_bytes()[:-5])

    assert main(["replay", str(tmp_path / "torn.mcap"), "--out", str(tmp_path / "again")]) == 130
    assert "interrupted: torn.mcap was cut off" in capsys.readouterr().out
    samples, all_of_it = (
        [each for each in messages(path) if "sample" in str(each)]
        for path in (tmp_path / "again" / "torn.mcap", tmp_path / "live.mcap")
    )
    assert 0 < len(samples) <= len(all_of_it)


def test_every_vehicle_is_one_json_object_a_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    endpoint = f"udpin:127.0.0.1:{free_udp_port()}"
    code = main(
        ["live", endpoint, "--seconds", "0.3", "--sysid", "all", "--json", "--out", str(tmp_path)]
    )
    [line] = capsys.readouterr().out.splitlines()
    assert (code, json.loads(line)["verdict"]["reasons"][0]["id"]) == (3, "no_vehicle")


def test_a_replay_of_every_vehicle_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    assert main(["replay", str(tmp_path / "x.tlog"), "--sysid", "all"]) == 2
    assert "sysid" in capsys.readouterr().err
