"""The sealed aircraft: none on which a limit is chosen, and each has the mode that is noted."""

from __future__ import annotations

import tomllib
from typing import Any

import numpy as np
import pytest
from flights.lateral import FRESH
from flights.moved import AIRCRAFT
from flights.plan import FlightPlan
from flights.truth import linear_dutch_rolls
from places import TOOLS

SEALED: dict[str, list[dict[str, Any]]] = tomllib.loads(
    (TOOLS / "flights" / "sealed.toml").read_text(encoding="utf-8")
)


def test_the_sealed_aircraft_are_eight_or_more_that_no_limit_was_chosen_on() -> None:
    names = {each["aircraft"] for each in SEALED["jsbsim"]}

    assert len(names) >= 8
    assert names.isdisjoint({each[0] for each in (*AIRCRAFT, *FRESH)})
    assert names.isdisjoint(SEALED["excluded"])


@pytest.mark.parametrize("own", SEALED["jsbsim"], ids=lambda own: str(own["aircraft"]))
def test_a_sealed_aircraft_finds_a_trim_and_has_the_dutch_roll_that_is_noted(
    own: dict[str, Any],
) -> None:
    gain = own.get("roll_gain", 1.0)
    plan = FlightPlan(
        own["aircraft"], own["speeds_kt"][0], own["altitude_ft"],
        roll_gain=gain, roll_rate_gain=0.3 * gain,
    )  # fmt: skip

    found = linear_dutch_rolls(plan)

    bare = found["dutch_roll_open_loop"]
    assert (bare["wn_rad_s"], bare["zeta"]) == pytest.approx(own["modes"][0], rel=0.005, abs=0.001)
    assert found["dutch_roll"]["zeta"] < 0.6
    assert len(own["modes"]) == len(own["speeds_kt"])


@pytest.mark.parametrize("own", SEALED["linear"], ids=lambda own: str(own["aircraft"]))
def test_a_linear_aircraft_has_the_dutch_roll_that_is_noted(own: dict[str, Any]) -> None:
    A = np.zeros((4, 4))
    A[0] = own["Y_beta"], 0.0, -1.0, 9.80665 / own["airspeed_m_s"]
    A[1, :3] = own["L_beta"], own["L_p"], own["L_r"]
    A[2, :3] = own["N_beta"], own["N_p"], own["N_r"]
    A[3, 1] = 1.0

    poles = np.linalg.eigvals(A)
    pair = poles[np.argmax(poles.imag)]

    assert (abs(pair), -pair.real / abs(pair)) == pytest.approx(
        own["modes"][0], rel=0.001, abs=0.001
    )
