"""A live session is a tlog being written: its replay gives the same estimates, bit for bit."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import threading
from pathlib import Path

import fly_jsbsim
import pytest
from jsbsim_flight import FlightPlan
from mcap.reader import make_reader
from telemetry import Link

from yawid.live import live
from yawid.outputs import Outputs
from yawid.run_config import RunConfig
from yawid.session import StopFlag, replay


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


def messages(path: Path) -> list[tuple[str, int, int, bytes]]:
    with path.open("rb") as stream:
        return [
            (channel.topic, message.log_time, message.publish_time, message.data)
            for _, channel, message in make_reader(stream).iter_messages()
            if channel.topic != "/yawid/verdict"
        ]


def test_replaying_the_recorded_session_gives_the_same_bits(tmp_path: Path):
    frames = list(fly_jsbsim.fly(FlightPlan(seconds=25.0), Link(attitude_hz=50.0, servo_hz=50.0)))
    port, stop, heard = free_port(), StopFlag(), threading.Event()
    config = RunConfig(rate=10.0)
    results = []

    def listen() -> None:
        outputs = Outputs(tmp_path, "live", "save")
        say = heard.set
        results.append(
            live(f"udpin:127.0.0.1:{port}", config, outputs, stop, 60.0, lambda text: say())
        )

    thread = threading.Thread(target=listen)
    thread.start()
    assert heard.wait(30.0)
    fly_jsbsim.send(frames, ("127.0.0.1", port), 25.0)
    wait_for_size(tmp_path / "live.tlog.part", sum(8 + len(frame) for _, frame in frames))
    stop.is_set = True
    thread.join()

    summary, _ = results[0]
    again, _ = replay(tmp_path / "live.tlog", config, Outputs(tmp_path, "again"), StopFlag())

    assert summary["estimates"] == again["estimates"]
    assert summary["estimates"]["els"]["updates"] > 100
    assert summary["link"]["frames"] == len(frames)
    assert messages(tmp_path / "live.mcap") == messages(tmp_path / "again.mcap")
    assert (tmp_path / "live.rrd").stat().st_size > 10_000
    assert set(summary["files"]) == {"mcap", "rrd", "tlog"}


def wait_for_size(path: Path, size: int) -> None:
    """Wait until a file has grown to a size, which it does as fast as the tap reads."""
    grown = threading.Event()
    for _ in range(300):
        if path.exists() and path.stat().st_size >= size:
            return
        grown.wait(0.1)
    raise AssertionError(f"{path.name} has not grown to {size} bytes")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_a_session_with_every_file_finished(number: int, tmp_path: Path):
    port = free_port()
    arguments = [f"udpin:127.0.0.1:{port}", "--out", str(tmp_path), "--json"]
    process = subprocess.Popen(
        [sys.executable, "-m", "yawid", "live", *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | {"PYTHONUNBUFFERED": "1"},
    )
    assert process.stderr is not None
    assert "listening" in process.stderr.readline()
    plan, link = FlightPlan(seconds=3.0), Link(attitude_hz=50.0, servo_hz=50.0)
    frames = list(fly_jsbsim.fly(plan, link))
    fly_jsbsim.send(frames, ("127.0.0.1", port), 100.0)
    for _ in range(300):
        parts = list(tmp_path.glob("*.tlog.part"))
        if parts:
            wait_for_size(parts[0], sum(8 + len(frame) for _, frame in frames))
            break
        threading.Event().wait(0.1)
    process.send_signal(number)
    out, err = process.communicate(timeout=60)

    assert process.returncode in (0, 5), err
    assert out.count("\n") == 1
    assert {path.suffix for path in tmp_path.iterdir()} == {".tlog", ".mcap"}


def test_a_link_nobody_sends_on_has_no_vehicle_and_leaves_no_file(tmp_path: Path):
    endpoint = f"udpin:127.0.0.1:{free_port()}"
    outputs = Outputs(tmp_path, "live")

    summary, verdict = live(endpoint, RunConfig(), outputs, StopFlag(), 0.3, lambda text: None)

    assert verdict.exit_code == 3
    assert summary["files"] == {}
    assert list(tmp_path.iterdir()) == []


def test_no_record_writes_no_tlog(tmp_path: Path):
    port, stop, ready = free_port(), StopFlag(), threading.Event()
    outputs = Outputs(tmp_path, "live", record=False)
    thread = threading.Thread(
        target=live,
        args=(f"udpin:127.0.0.1:{port}", RunConfig(), outputs, stop, 30.0, lambda t: ready.set()),
    )
    thread.start()
    assert ready.wait(30.0)
    plan, link = FlightPlan(seconds=2.0), Link(attitude_hz=50.0, servo_hz=50.0)
    fly_jsbsim.send(list(fly_jsbsim.fly(plan, link)), ("127.0.0.1", port), 100.0)
    for _ in range(300):
        if list(tmp_path.glob("*.mcap.part")):
            break
        threading.Event().wait(0.1)
    stop.is_set = True
    thread.join()

    assert [path.name for path in tmp_path.iterdir()] == ["live.mcap"]
