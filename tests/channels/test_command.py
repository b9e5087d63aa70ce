"""A log of commands that were not carried out is refused, or at least said to be one."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from flightlog import beat, every, fly, hud, reason_ids, reasons_of, summarised, summary_of
from places import SHARED_FLIGHTS as FLIGHTS
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from scipy.signal import cont2discrete, lfilter
from sources.logs.ulog_flight import ULogFile

from yawid.blocks import Floats
from yawid.config.run import RunConfig

SECONDS, START_S, HZ = 30.0, 10.0, 25.0
ARMED, DISARMED = 128, 0


def still(t: float) -> int:
    return 1500


def moving(t: float) -> int:
    return 1500 + round(4 * np.sin(t))


def early(t: float) -> int:
    return 1500 + (round(20 * t) if t < 5.0 else 100)


def commanded(
    pulse: Callable[[float], int] = still,
    *,
    base_mode: int = ARMED,
    groundspeed: Callable[[float], float] = lambda t: 20.0,
    servo_s: float = 0.04,
    rudder: Floats | None = None,
    rate: Floats | None = None,
) -> bytes:
    """Return PX4's log of control 2 next to one output; rudder and yaw rate (n,) are at HZ."""

    def of(values: Floats | None, t: float, other: float) -> float:
        return other if values is None else float(values[round(HZ * t)])

    def controls(t: float) -> Any:
        deflection = of(rudder, t, 0.2 * (round(HZ * t) // 20 % 2))
        us = round(1e6 * (START_S + t + 0.01))
        return mavlink.MAVLink_actuator_control_target_message(us, 0, [0, 0, deflection, *[0] * 5])

    beats = every(1.0, SECONDS, lambda t: beat(1, 12, base_mode))
    speeds = every(
        1.0, SECONDS, lambda t: hud(groundspeed(t), groundspeed(t), 100 + groundspeed(t))
    )
    return fly(
        lambda t: of(rate, t, 0.1 * np.sin(t)),
        lambda t: [0, pulse(t), 1500],
        SECONDS,
        attitude_s=1.0 / HZ,
        servo_s=servo_s,
        vehicle=beat(1, 12, base_mode),
        more=[*beats, *speeds, *every(1.0 / HZ, SECONDS, controls)],
    ).data


@pytest.mark.parametrize(
    ("log", "config", "in_command"),
    [
        ({}, {}, False),
        ({"pulse": moving}, {}, True),
        ({"pulse": lambda t: 1500 + (t > 5.0)}, {}, False),  # by rounding alone
        ({"pulse": lambda t: 0 if t < 5.0 else 1500}, {}, False),  # off, then still
        ({"servo_s": 4.0}, {}, True),  # hardly heard
        ({"pulse": early}, {}, True),
        ({"pulse": early}, {"from_s": START_S + 6.0}, False),
        ({"pulse": early, "groundspeed": lambda t: 0.0 if t < 6.0 else 20.0}, {}, False),
        ({"pulse": moving, "base_mode": DISARMED}, {}, True),
        ({"base_mode": DISARMED}, {}, False),
        ({"base_mode": DISARMED}, {"rudder": "control:2"}, True),  # named, so believed
    ],
)
def test_one_output_that_moves_in_flight_is_command_enough(
    log: dict[str, Any], config: dict[str, Any], in_command: bool
):
    said = reason_ids(of_stream(commanded(**log), config))
    assert ("not_in_command" not in said) == in_command


def of_stream(log: bytes, config: dict[str, Any]) -> dict[str, Any]:
    return summary_of(log, RunConfig(**({"manoeuvres": "off"} | config)))


def test_what_stood_still_is_said_by_number_and_disarmed_alone_is_a_warning():
    refused, named = (
        {each["id"]: each for each in reasons_of(of_stream(commanded(base_mode=mode), config))}
        for mode, config in ((ARMED, {}), (DISARMED, {"rudder": "control:2"}))
    )
    outputs = "SERVO_OUTPUT_RAW outputs 2, 3 stood still at 1500"
    assert outputs in refused["not_in_command"]["text"]
    assert outputs in named["disarmed"]["text"]
    assert "--rudder control:2 says that this channel moves the rudder" in named["disarmed"]["text"]
    assert named["disarmed"]["weight"] == "warning"


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


N = round(HZ * SECONDS)
PULSES = 0.3 * np.repeat(np.random.default_rng(3).choice([-1.0, 1.0], N // 15 + 1), 15)[:N]


def swinging(x: Floats) -> Floats:
    """Return the response to x (n,) of a pair of poles at 5 rad/s and a damping of .4."""
    b, a, _ = cont2discrete(([25.0], [1.0, 4.0, 25.0]), 1.0 / HZ)
    answered: Floats = lfilter(b[0], a, x)
    return answered


GUSTS = swinging(np.random.default_rng(4).standard_normal(N))


def test_a_rudder_that_the_yaw_rate_clearly_follows_was_moved_by_somebody():
    """A pilot's receiver may move the servos by the same sticks: a warning, with the share."""
    clear, hidden = (
        {
            each["id"]: each["text"]
            for each in reasons_of(
                of_stream(commanded(base_mode=DISARMED, rudder=PULSES, rate=rate), {})
            )
        }
        for rate in (
            swinging(PULSES) + 0.05 * GUSTS,
            0.3 * swinging(PULSES) + 0.3 * GUSTS,
        )
    )
    assert "not_in_command" not in clear
    share = re.search(
        r"outputs 2, 3 stood still at 1500; the rudder explains (\d+) %", clear["disarmed"]
    )
    assert int(share[1]) > 80
    assert "not_in_command" in hidden


@pytest.mark.parametrize("gain", [-0.5, 0.5])
def test_a_rudder_that_follows_the_yaw_rate_is_a_passengers(gain: float):
    """The loop of an autopilot that is taken along: nothing is as coherent."""
    rate = swinging(np.random.default_rng(5).standard_normal(N))
    reaction = gain * np.concatenate([np.zeros(3), rate[:-3]])
    log = commanded(base_mode=DISARMED, rudder=reaction, rate=rate)

    assert "not_in_command" in reason_ids(of_stream(log, {}))


@pytest.mark.skipif(not FLIGHTS.is_dir(), reason="the recorded flights are not here")
@pytest.mark.parametrize(
    ("name", "config", "zeta"),
    # CATALOG.md: control 2 of the first is the same stick; 1.19 to 1.32 rad/s, zeta .35 to .53.
    [("dawn1_flight1", {}, 0.45), ("seaway_flight3", {"rudder": "control:2"}, None)],
)
def test_a_flight_by_the_receiver_of_an_autopilot_never_armed_is_refused_or_right(
    name: str, config: dict[str, Any], zeta: float | None
):
    summary = summarised(FLIGHTS / f"{name}.ulg", RunConfig(ordinary="off", **config))

    weights = {reason.id: reason.weight for reason in summary.verdict.reasons}
    assert weights["disarmed"] == "warning"
    if summary.verdict.usable:
        roll = summary.flight.dutch_roll
        assert 1.19 <= roll.wn_rad_s <= 1.35
        assert roll.zeta == pytest.approx(zeta, abs=0.15)
