"""What ``yawid inspect`` says is to be recorded next time: message, rate, manoeuvre, parameter."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from flightlog import FlightLog
from inspecting import inspected


def advice_for(log: FlightLog, tmp_path: Path, capsys, *options: str) -> str:
    _, report = inspected(log.data, tmp_path, capsys, *options)
    return " | ".join(report.get("record", []))


def test_a_slow_log_is_told_the_rates_to_ask_its_autopilot_for(tmp_path: Path, capsys):
    def slow(autopilot: int) -> FlightLog:
        log = FlightLog()
        log.heartbeat(10.0, autopilot=autopilot)
        for t in np.arange(10.0, 40.0, 0.3).tolist():
            log.attitude(t, 0.1)
            log.servos(t, [1500] * 8)
        return log

    options = ("--rudder", "servo:4")
    assert "SRn_EXTRA1 = 25" in advice_for(slow(3), tmp_path, capsys, *options)
    assert "mavlink stream" in advice_for(slow(12), tmp_path, capsys, *options)
    assert "MAV_CMD_SET_MESSAGE_INTERVAL" in advice_for(slow(0), tmp_path, capsys, *options)


def test_what_a_log_without_rudder_is_told_depends_on_why(tmp_path: Path, capsys):
    attitudes = np.arange(10.0, 20.0, 0.05).tolist()
    multirotor, functions, silent, unnamed = (FlightLog() for _ in range(4))
    multirotor.heartbeat(9.0, kind=2)
    unnamed.heartbeat(9.0, kind=0)
    for log in (functions, silent):
        log.heartbeat(9.0)
    functions.parameter(9.5, "SERVO4_FUNCTION", 4.0)
    for log in (multirotor, functions, silent, unnamed):
        for t in attitudes:
            log.attitude(t, 0.1)

    assert "has no rudder: record an aircraft that has one" in advice_for(
        multirotor, tmp_path, capsys
    )
    assert "SERVOn_FUNCTION = 21" in advice_for(functions, tmp_path, capsys)
    assert "ask for SERVO_OUTPUT_RAW" in advice_for(silent, tmp_path, capsys)
    assert "download the parameters" in advice_for(unnamed, tmp_path, capsys)


def test_a_rudder_that_only_follows_the_aileron_is_told_how_to_part_them(tmp_path: Path, capsys):
    log = FlightLog()
    log.heartbeat(10.0)
    for t in np.arange(10.0, 40.0, 0.05).tolist():
        stick = round(200 * np.sin(1.3 * t) * np.cos(0.4 * t))
        log.attitude(t, 0.3 * np.sin(1.3 * t - 0.5))
        log.servos(t, [1500 + stick, 1500, 1500, 1500 + stick // 2])

    code, report = inspected(log.data, tmp_path, capsys, "--inputs", "rudder,aileron")
    told = advice_for(log, tmp_path, capsys, "--inputs", "rudder,aileron")

    assert code == 5
    ids = [reason["id"] for reason in report["verdict"]["reasons"]]
    assert ids[:1] == ["mixed_rudder"]
    assert "KFF_RDDRMIX = 0" in told  # parameter
    assert "3-2-1-1" in told  # manoeuvre
    assert "download the parameters" in told  # the channel was assumed


def test_nobody_heard_and_no_yaw_are_told_what_to_ask_for(tmp_path: Path, capsys):
    ground, blind = FlightLog(), FlightLog()
    ground.heartbeat(1.0, kind=6, autopilot=8)
    ground.heartbeat(2.0, kind=6, autopilot=8)
    blind.heartbeat(1.0)
    blind.servos(2.0, [1500] * 8)

    assert "HEARTBEAT" in advice_for(ground, tmp_path, capsys)
    assert "ATTITUDE (30)" in advice_for(blind, tmp_path, capsys)
