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
