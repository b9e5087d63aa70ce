"""The sealed aircraft of sealed.toml as places of the benches: on them no limit is ever chosen."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

from flights.plan import KNOT, FlightPlan, Place

PATH = Path(__file__).with_name("sealed.toml")


def sealed_places() -> list[Place]:
    """Return name, altitude in ft and airspeed in kt of the sealed aircraft, each at its speeds."""
    own = tomllib.loads(PATH.read_text(encoding="utf-8"))
    return _of_jsbsim(own["jsbsim"]) + [
        (each["aircraft"], 1000.0, round(each["airspeed_m_s"] / KNOT, 3)) for each in own["linear"]
    ]


def nonlinear_places() -> list[Place]:
    """Return the places of the file's opened aircraft, on which a limit may be chosen."""
    return _of_jsbsim(tomllib.loads(PATH.read_text(encoding="utf-8"))["nonlinear"])


def _of_jsbsim(some: list[dict[str, Any]]) -> list[Place]:
    return [
        (each["aircraft"], each["altitude_ft"], knots)
        for each in some
        for knots in each["speeds_kt"]
    ]


def sealed(name: str) -> dict[str, Any]:
    """Return what the file has about an aircraft, sealed or opened; {} if it does not have it."""
    own = tomllib.loads(PATH.read_text(encoding="utf-8"))
    every = (*own["jsbsim"], *own["linear"], *own.get("nonlinear", ()))
    return next((each for each in every if each["aircraft"] == name), {})


def plan_at(place: Place, **given: Any) -> FlightPlan:
    """Return the plan of a flight at a place, with the roll hold that a sealed aircraft needs."""
    name, feet, knots = place
    own = sealed(name)
    if gain := own.get("roll_gain"):
        given |= {"roll_gain": gain, "roll_rate_gain": own.get("roll_rate_gain", 0.3 * gain)}
    return FlightPlan(aircraft=name, altitude_ft=feet, speed_kt=knots, **given)
