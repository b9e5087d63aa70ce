"""Whole flights by plan: each manoeuvre's truth is found at the airspeed that was flown in it."""

import json
from typing import Any

import fly_jsbsim
import numpy as np
import pytest
from flights.fly import LegFlight
from flights.plan import FlightPlan, Leg
from flights.surgery import messages, split
from flights.telemetry import Link

TOML = """
aircraft = "T37"
speed_kt = 200.0
leg = [
    {kind = "idle", seconds = 10.0},
    {kind = "manoeuvre", seconds = 50.0},
    {kind = "speed", seconds = 30.0, speed_kt = 230.0},
    {kind = "idle", seconds = 15.0},
    {kind = "manoeuvre", seconds = 30.0, shape = "doublets", mode = "MANUAL"},
]
"""
RUDDER = "SERVO_OUTPUT_RAW"


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> tuple[list[Any], list[dict[str, Any]]]:
    """The plan, flown by the command: its messages with ``at_s``, their boot time, and its truth"""
    folder, found, at_s = tmp_path_factory.mktemp("plan"), [], 0.0
    (folder / "plan.toml").write_text(TOML, encoding="utf-8")
    log = folder / "log.tlog"
    argv = ["--plan", str(folder / "plan.toml"), "-o", str(log)]
    assert fly_jsbsim.main([*argv, "--attitude-hz", "25", "--servo-hz", "25"]) == 0
    for message in messages(split(log.read_bytes()), "ATTITUDE", RUDDER, "VFR_HUD"):
        at_s = getattr(message, "time_boot_ms", 1e3 * at_s) / 1e3
        message.at_s = at_s
        found.append(message)
    truth = json.loads((folder / "log.truth.json").read_text(encoding="utf-8"))
    return found, truth["manoeuvres"]


def test_the_truth_is_of_the_airspeed_flown_not_of_the_trim_before(flown: Any) -> None:
    sent, manoeuvres = flown
    hud = [m for m in sent if m.get_type() == "VFR_HUD"]

    assert len(manoeuvres) == 2
    for true in manoeuvres:
        first, last = true["from_s"] + 0.5, true["to_s"] - 0.5
        speeds = [m.airspeed for m in hud if first < m.at_s < last]
        ratio = true["dutch_roll"]["wn_rad_s"] / true["dutch_roll_at_trim"]["wn_rad_s"]
        speed_ratio = true["calibrated_kt"] / true["calibrated_kt_at_trim"]

        assert true["airspeed_m_s"] == pytest.approx(np.mean(speeds), rel=0.005)
        assert 0.95 < speed_ratio < 0.998
        assert ratio == pytest.approx(speed_ratio, abs=0.003)


def test_from_and_to_are_the_rudder_s_first_and_last_movement(flown: Any) -> None:
    rudder = [m for m in flown[0] if m.get_type() == RUDDER]
    still = rudder[0].servo4_raw
    moved_s = np.array([m.time_usec / 1e6 for m in rudder if m.servo4_raw != still])

    for true in flown[1]:
        own = moved_s[(moved_s > true["from_s"] - 5) & (moved_s < true["to_s"] + 5)]
        assert own[0] == pytest.approx(true["from_s"], abs=0.05)
        assert own[-1] == pytest.approx(true["to_s"], abs=0.05)
        assert own[0] >= true["from_s"]
        assert own[-1] <= true["to_s"]
        assert np.max(np.diff(own)) < 5.0  # a rest that long would end it


def test_a_landing_ends_on_the_wheels_and_a_go_around_climbs() -> None:
    plan = FlightPlan(
        "c172p",
        70.0,
        legs=(
            Leg("climb", 15.0, climb_ft_min=-500.0),
            Leg("go_around", 15.0, climb_ft_min=500.0, rudder_hold=0.15, speed_kt=75.0),
            Leg("landing", 65.0, climb_ft_min=-500.0, speed_kt=65.0),
        ),
        altitude_ft=200.0,
    )
    flight, heights, feet_us = LegFlight(plan, Link()), [], []
    for ms in (14_000, 22_000, 30_000):
        flight.advance_to(ms)
        heights.append(flight["position/h-agl-ft"])
        feet_us.append(flight.rudder_us)
    flight.advance_to(95_000)

    assert heights[0] < 160.0
    assert heights[2] > heights[1] > heights[0] - 30.0
    assert feet_us[1] - feet_us[0] == pytest.approx(60, abs=1)
    assert flight["position/h-agl-ft"] < 6.0
    assert flight["velocities/vg-fps"] < 30.0
    assert abs(flight["attitude/phi-rad"]) < 0.05
