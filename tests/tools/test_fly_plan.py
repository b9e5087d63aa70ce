"""Whole flights by plan: each manoeuvre's truth is found at the airspeed that was flown in it."""

import json
from pathlib import Path
from typing import Any

import fly_jsbsim
import numpy as np
import pytest
from flights.fly import LegFlight
from flights.plan import FlightPlan, Leg
from flights.surgery import split
from flights.telemetry import Link
from pymavlink.dialects.v20 import ardupilotmega as v2

TOML = """
aircraft = "T37"
speed_kt = 200.0
leg = [
    {kind = "idle", seconds = 10.0},
    {kind = "manoeuvre", seconds = 50.0},
    {kind = "turn", seconds = 20.0, bank_deg = 20.0},
    {kind = "idle", seconds = 20.0},
    {kind = "manoeuvre", seconds = 30.0, shape = "doublets", mode = "MANUAL"},
    {kind = "speed", seconds = 30.0, speed_kt = 230.0},
    {kind = "idle", seconds = 15.0},
    {kind = "manoeuvre", seconds = 50.0},
]
"""
RUDDER, AILERON = "servo4_raw", "servo1_raw"


def fly(folder: Path, toml: str, *options: str) -> tuple[Path, dict[str, Any]]:
    """Fly a plan by the command; return the log and its truth."""
    (folder / "plan.toml").write_text(toml, encoding="utf-8")
    log = folder / "log.tlog"
    argv = ["--plan", str(folder / "plan.toml"), "-o", str(log), *options]
    assert fly_jsbsim.main([*argv, "--attitude-hz", "25", "--servo-hz", "25"]) == 0
    return log, json.loads((folder / "log.truth.json").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    return fly(tmp_path_factory.mktemp("plan"), TOML)


@pytest.fixture(scope="module")
def messages(flown: tuple[Path, dict[str, Any]]) -> list[Any]:
    return decoded(flown[0])


def decoded(log: Path) -> list[Any]:
    """Every vehicle's message; each gets ``at_s``, the boot second it was sent at."""
    mav, found, at_s = v2.MAVLink(None), [], 0.0
    for _, frame in split(log.read_bytes()):
        message = mav.decode(bytearray(frame))
        at_s = getattr(message, "time_boot_ms", 1e3 * at_s) / 1e3
        message.at_s = at_s
        if message.get_srcSystem() == 1:
            found.append(message)
    return found


def told(messages: list[Any], name: str, field: str, within: dict[str, float]) -> list[Any]:
    """Return one field of one message in a leg or manoeuvre; half a second at its ends is not."""
    first, last = within["from_s"] + 0.5, within["to_s"] - 0.5
    return [getattr(m, field) for m in messages if m.get_type() == name and first < m.at_s < last]


def test_the_truth_is_of_the_airspeed_flown_not_of_the_trim_before(
    flown: tuple[Path, dict[str, Any]], messages: list[Any]
) -> None:
    for told_of in flown[1]["manoeuvres"]:
        speeds = told(messages, "VFR_HUD", "airspeed", told_of)
        ratio = told_of["dutch_roll"]["wn_rad_s"] / told_of["dutch_roll_at_trim"]["wn_rad_s"]
        speed_ratio = told_of["calibrated_kt"] / told_of["calibrated_kt_at_trim"]

        assert told_of["airspeed_m_s"] == pytest.approx(np.mean(speeds), rel=0.005)
        assert 0.95 < speed_ratio < 0.998
        assert ratio == pytest.approx(speed_ratio, abs=0.003)


def test_from_and_to_are_the_rudder_s_first_and_last_movement(
    flown: tuple[Path, dict[str, Any]], messages: list[Any]
) -> None:
    rudder = [m for m in messages if m.get_type() == "SERVO_OUTPUT_RAW"]
    still = rudder[0].servo4_raw
    moved_s = np.array([m.time_usec / 1e6 for m in rudder if m.servo4_raw != still])

    for told_of in flown[1]["manoeuvres"]:
        own = moved_s[(moved_s > told_of["from_s"] - 5) & (moved_s < told_of["to_s"] + 5)]
        assert own[0] == pytest.approx(told_of["from_s"], abs=0.05)
        assert own[-1] == pytest.approx(told_of["to_s"], abs=0.05)
        assert own[0] >= told_of["from_s"]
        assert own[-1] <= told_of["to_s"]
        assert np.max(np.diff(own)) < 5.0  # a rest that long would end it


def test_a_landing_ends_on_the_wheels_and_a_go_around_climbs() -> None:
    plan = FlightPlan(
        "c172p",
        70.0,
        legs=(
            Leg("climb", 15.0, climb_ft_min=-500.0),
            Leg("go_around", 15.0, climb_ft_min=500.0, rudder_hold=0.15, speed_kt=75.0),
            Leg("landing", 85.0, climb_ft_min=-500.0, speed_kt=65.0),
        ),
        altitude_ft=300.0,
    )
    flight, heights, feet_us = LegFlight(plan, Link()), [], []
    for ms in (14_000, 22_000, 30_000):
        flight.advance_to(ms)
        heights.append(flight["position/h-agl-ft"])
        feet_us.append(flight.rudder_us)
    flight.advance_to(115_000)

    assert heights[0] < 260.0
    assert heights[2] > heights[1] > heights[0] - 30.0
    assert feet_us[1] - feet_us[0] == pytest.approx(60, abs=1)
    assert flight["position/h-agl-ft"] < 6.0
    assert flight["velocities/vg-fps"] < 30.0
    assert abs(flight["attitude/phi-rad"]) < 0.05
