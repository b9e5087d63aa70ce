"""What a flight's truth file says is what the simulated aircraft does."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from flights import truth as jsbsim_truth
from flights.plan import FlightPlan


def steady(plan: Any) -> Any:
    """A flight that stays at its trim, as it is noted."""
    return np.array([[10.0, plan.speed_kt, plan.altitude_ft]])


@pytest.mark.parametrize(
    ("aircraft", "speed_kt", "altitude_ft"), [("c172p", 100.0, 3000.0), ("T37", 200.0, 10000.0)]
)
def test_the_linearised_dutch_roll_is_what_decays_after_a_rudder_pulse(
    aircraft: str, speed_kt: float, altitude_ft: float
) -> None:
    plan = FlightPlan(aircraft=aircraft, speed_kt=speed_kt, altitude_ft=altitude_ft)

    found = jsbsim_truth.truth(plan, steady(plan))

    linear, seen = found["dutch_roll"], found["dutch_roll_pulse"]
    assert seen["wn_rad_s"] == pytest.approx(linear["wn_rad_s"], rel=0.005)
    assert seen["zeta"] == pytest.approx(linear["zeta"], abs=0.005)
    assert abs(seen["zeta"] - found["dutch_roll_open_loop"]["zeta"]) > 0.03
    assert linear["wn_std"] == pytest.approx(abs(seen["wn_rad_s"] - linear["wn_rad_s"]))
    assert found["dutch_roll_at_trim"]["wn_rad_s"] == linear["wn_rad_s"]
    assert jsbsim_truth.disagreement(found) is None


def test_the_sigma_of_a_truth_has_the_airspeeds_flown_and_the_pulse_in_it() -> None:
    plan = FlightPlan(aircraft="T37", speed_kt=200.0, altitude_ft=5000.0)
    wavy = np.array([[10.0 + i, 190.0 + 4.0 * (-1) ** i, 5000.0] for i in range(20)])

    found = jsbsim_truth.truth(plan, wavy)["dutch_roll"]

    line = jsbsim_truth.truth_lines(plan, wavy)["dutch_roll"]
    ends = [jsbsim_truth.linear_dutch_rolls(replace(plan, speed_kt=v)) for v in (186.0, 194.0)]
    slow, fast = (end["dutch_roll"]["wn_rad_s"] for end in ends)
    assert slow < found["wn_rad_s"] < fast
    spread = 0.5 * (fast - slow)
    assert found["wn_std"] == pytest.approx(np.hypot(spread, line["pulse"][0]), rel=0.01)
    at_194, _ = jsbsim_truth.at_airspeeds(line, np.array([194.0]))
    assert at_194[0] == pytest.approx(fast, rel=1e-3)


def test_without_roll_hold_the_closed_loop_is_the_open_one() -> None:
    plan = FlightPlan("T37", 200.0, 5000.0, roll_gain=0.0, roll_rate_gain=0.0)
    found = jsbsim_truth.truth(plan, steady(plan))

    assert found["dutch_roll"] == pytest.approx(found["dutch_roll_open_loop"], rel=1e-12)


def test_decay_modes_gives_back_the_exponentials_a_response_was_made_of() -> None:
    t = np.arange(200) * 0.05
    response = np.exp(-0.5 * t) * np.cos(2.4 * t + 0.3) + 0.3 * np.exp(-0.9 * t)

    poles, amplitudes = jsbsim_truth.decay_modes(response, 0.05, order=3)
    mode = jsbsim_truth.strongest_pair(poles, amplitudes)

    assert mode["wn_rad_s"] == pytest.approx(abs(-0.5 + 2.4j), rel=1e-8)
    assert mode["zeta"] == pytest.approx(0.5 / abs(-0.5 + 2.4j), rel=1e-8)


def test_an_aircraft_whose_controls_have_dynamics_is_told_apart() -> None:
    linear, other = {"wn_rad_s": 4.37, "zeta": 0.144}, {"wn_rad_s": 4.44, "zeta": 0.100}
    found = {"aircraft": "X", "dutch_roll": linear, "dutch_roll_pulse": other}

    assert "X's controls have dynamics" in jsbsim_truth.disagreement(found)
    assert "no oscillatory" in jsbsim_truth.disagreement(found | {"dutch_roll_pulse": None})
