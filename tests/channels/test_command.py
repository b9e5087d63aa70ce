"""A log of commands that nobody carried out is refused, or at least said to be one."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from flightlog import FlightLog, reason_ids, reasons_of, samples_of, summarised, summary_of
from places import SHARED_FLIGHTS as FLIGHTS
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from scipy.signal import cont2discrete, lfilter
from sources.logs.ulog_writer import ULogFile

from yawid.blocks import Floats
from yawid.cli.main import main
from yawid.config.run import RunConfig

SECONDS, START_S = 30.0, 10.0
ARMED, DISARMED = 128, 0


def tlog(
    pulse: Callable[[float], int],
    *,
    base_mode: int = ARMED,
    groundspeed: Callable[[float], float] = lambda t: 20.0,
    servos_each: int = 1,
) -> bytes:
    """Return PX4's log of a moving control 2 beside one output, a function of time."""
    log = FlightLog()
    for i in range(round(25 * SECONDS)):
        s = 0.04 * i
        t = START_S + s
        if i % 25 == 0:
            log.add(t, mavlink.MAVLink_heartbeat_message(1, 12, base_mode, 0, 4, 3))
            over_ground = groundspeed(s)
            speeds, altitude = (over_ground, over_ground), 100.0 + over_ground
            log.add(t, mavlink.MAVLink_vfr_hud_message(*speeds, 0, 50, altitude, 0.0))
        log.attitude(t, 0.1 * np.sin(t))
        rudder = [0.0, 0.0, 0.2 * (i // 20 % 2), *[0.0] * 5]
        us = round(1e6 * (t + 0.01))
        log.add(t + 0.01, mavlink.MAVLink_actuator_control_target_message(us, 0, rudder))
        if i % servos_each == 0:
            log.servos(t + 0.02, [0, pulse(s), 1500])
    return log.data


def told(data: bytes, config: RunConfig | None = None) -> dict[str, str]:
    summary = summary_of(data, config)
    return {reason["id"]: reason["text"] for reason in reasons_of(summary)}


def test_outputs_that_stand_still_beside_commands_that_move_are_refused_by_number():
    said = told(tlog(lambda t: 1500))
    assert "SERVO_OUTPUT_RAW outputs 2, 3 stood still at 1500" in said["not_in_command"]


@pytest.mark.parametrize(
    ("pulse", "in_command"),
    [
        (lambda t: 1500 + round(20 * np.sin(t)), True),
        (lambda t: 1500 + (t > 5.0), False),  # by rounding alone
        (lambda t: 0 if t < 5.0 else 1500, False),  # off, then still
    ],
)
def test_one_output_that_moves_is_command_enough(pulse: Callable[[float], int], in_command: bool):
    assert ("not_in_command" not in told(tlog(pulse))) == in_command


def test_outputs_hardly_heard_are_not_called_still():
    assert "not_in_command" not in told(tlog(lambda t: 1500, servos_each=100))


def test_what_moves_outside_the_stretch_or_on_the_ground_does_not_count():
    def early(t: float) -> int:
        return 1500 + (round(20 * t) if t < 5.0 else 100)

    whole = tlog(early)
    assert "not_in_command" not in told(whole)
    assert "not_in_command" in told(whole, RunConfig(from_s=START_S + 6.0))
    parked = tlog(early, groundspeed=lambda t: 0.0 if t < 6.0 else 20.0)
    assert "not_in_command" in told(parked)


def test_heartbeats_that_say_disarmed_are_a_warning_and_never_the_verdict():
    def moving(t: float) -> int:
        return 1500 + round(20 * np.sin(t))

    said = summary_of(tlog(moving, base_mode=DISARMED))
    weights = {reason["id"]: reason["weight"] for reason in reasons_of(said)}
    assert weights["disarmed"] == "warning"
    assert not reason_ids(summary_of(tlog(moving))) & {"disarmed", "not_in_command"}


def ulog(arming: Callable[[float], int], path: Path) -> dict[str, Any]:
    """Return the summary of a ULog without outputs, of an arming state by time."""
    log = ULogFile({"MAV_TYPE": 1})
    for k in range(1500):
        now = 20_000 * k + 1000
        if k % 25 == 0:
            log.add("vehicle_status", now, arming(0.02 * k), 0, 1, 1)
        log.add("vehicle_angular_velocity", now + 1, 0, [0, 0, 0.1 * np.sin(0.02 * k)])
        log.add("actuator_controls_0", now + 2, [0.1, 0.0, 0.25 * (k // 50 % 2)])
    path.write_bytes(log.data)
    return summarised(path, RunConfig(manoeuvres="off")).to_json()


def test_an_on_board_log_disarmed_throughout_is_refused(tmp_path: Path):
    never = ulog(lambda t: 1, tmp_path / "never.ulg")["verdict"]["reasons"]
    later = ulog(lambda t: 1 if t < 20.0 else 2, tmp_path / "later.ulg")

    assert never[0]["id"] == "not_in_command"
    assert "PX4 was never armed" in never[0]["text"]
    assert not reason_ids(later) & {"not_in_command", "disarmed"}


def carried(rudder: Floats, rate: Floats) -> bytes:
    """Return PX4's log, disarmed and its outputs still, of control 2 and yaw rate (n,) at 25 Hz"""
    log = FlightLog()
    for i, (deflection, yaw_rate) in enumerate(zip(rudder.tolist(), rate.tolist(), strict=True)):
        t = START_S + 0.04 * i
        if i % 25 == 0:
            log.add(t, mavlink.MAVLink_heartbeat_message(1, 12, DISARMED, 0, 4, 3))
            log.add(t, mavlink.MAVLink_vfr_hud_message(20.0, 20.0, 0, 50, 100.0, 0.0))
        log.attitude(t, yaw_rate)
        controls, us = [0.0, 0.0, deflection, *[0.0] * 5], round(1e6 * (t + 0.01))
        log.add(t + 0.01, mavlink.MAVLink_actuator_control_target_message(us, 0, controls))
        log.servos(t + 0.02, [0, 1500, 1500])
    return log.data


def pulses(n: int) -> Floats:
    """Pulses of .6 s that go either way"""
    signs = np.random.default_rng(3).choice([-1.0, 1.0], n // 15 + 1)
    return 0.3 * np.repeat(signs, 15)[:n]


def swinging(x: Floats) -> Floats:
    """What comes of x (n,) by a pair of poles at 5 rad/s and a damping of .4, a sample later"""
    b, a, _ = cont2discrete(([25.0], [1.0, 4.0, 25.0]), 0.04)
    answered: Floats = lfilter(b[0], a, x)
    return answered


def test_a_rudder_that_the_yaw_rate_clearly_follows_was_moved_by_somebody():
    """A pilot's receiver may move the servos by the same sticks: a warning, with the share"""
    n = round(25 * SECONDS)
    rudder, gusts = pulses(n), swinging(np.random.default_rng(4).standard_normal(n))
    clear = swinging(rudder) + 0.05 * gusts
    said = told(carried(rudder, clear))

    assert "not_in_command" not in said
    share = re.search(
        r"outputs 2, 3 stood still at 1500; the rudder explains (\d+) %", said["disarmed"]
    )
    assert int(share[1]) > 80
    hidden = told(carried(rudder, 0.3 * swinging(rudder) + 0.3 * gusts))
    assert "not_in_command" in hidden


@pytest.mark.parametrize("gain", [-0.5, 0.5])
def test_a_rudder_that_follows_the_yaw_rate_is_a_passengers(gain: float):
    """The loop of an autopilot that is taken along: nothing is as coherent"""
    rate = swinging(np.random.default_rng(5).standard_normal(round(25 * SECONDS)))
    reaction = gain * np.concatenate([np.zeros(3), rate[:-3]])

    assert "not_in_command" in told(carried(reaction, rate))


def test_a_channel_that_was_named_is_believed_with_a_warning():
    data = tlog(lambda t: 1500, base_mode=DISARMED)
    assert "not_in_command" in told(data)

    said = told(data, RunConfig(rudder="control:2"))
    assert "not_in_command" not in said
    assert "SERVO_OUTPUT_RAW outputs 2, 3 stood still at 1500" in said["disarmed"]
    assert "--rudder control:2 says that this channel moves the rudder" in said["disarmed"]


RECORDED = pytest.mark.skipif(not FLIGHTS.is_dir(), reason="the recorded flights are not here")


@RECORDED
def test_a_flight_by_the_receiver_of_an_autopilot_never_armed_is_refused_or_right():
    """CATALOG.md: its control 2 is the same stick; 1.19 to 1.32 rad/s, zeta .35 to .53"""
    summary = summarised(FLIGHTS / "dawn1_flight1.ulg", RunConfig())
    verdict = summary.verdict
    weights = {reason.id: reason.weight for reason in verdict.reasons}

    assert weights["disarmed"] == "warning"
    assert summary.flight is not None
    if verdict.usable:
        roll = summary.flight.dutch_roll
        assert 1.19 <= roll.wn_rad_s <= 1.35
        assert 0.3 <= roll.zeta <= 0.55


@RECORDED
def test_the_passengers_flight_is_refused_by_its_samples_where_its_channel_is_named():
    config = RunConfig(rudder="control:2")
    summary = summarised(FLIGHTS / "seaway_flight3.ulg", config)
    verdict = summary.verdict

    weights = {reason.id: reason.weight for reason in verdict.reasons}
    assert weights["disarmed"] == "warning"
    assert not verdict.usable
    assert not any(each.verdict.usable for each in summary.manoeuvres)


def test_the_facts_do_not_depend_on_the_cut():
    data = tlog(lambda t: 1500 + round(t), base_mode=DISARMED)
    config = RunConfig(from_s=START_S + 3.2, to_s=START_S + 5.7)
    whole = samples_of(data, config).channels.command
    cut = samples_of(data, config, range(0, len(data), 1511)).channels.command

    assert whole.outputs == cut.outputs
    assert (whole.moved, whole.armed, whole.disarmed) == (cut.moved, cut.armed, cut.disarmed)


@pytest.mark.long
@RECORDED
def test_the_flight_that_px4_was_a_passenger_of_is_refused_by_inspects_own_line(capsys, tmp_path):
    log = str(FLIGHTS / "seaway_flight3.ulg")
    main(["inspect", log, "--json"])
    report = json.loads(capsys.readouterr().out)
    assert report["verdict"]["reasons"][0]["id"] == "not_in_command"

    code = main(["replay", log, "--out", str(tmp_path), "--json"])
    first = json.loads(capsys.readouterr().out)["verdict"]["reasons"][0]

    assert (code, first["id"]) == (5, "not_in_command")
    assert "PX4 was never armed" in first["text"]
    assert "SERVO_OUTPUT_RAW outputs 17, 18, 19, 20 stood still at 1500" in first["text"]
