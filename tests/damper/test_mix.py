"""The mix in the autopilot's parameter, or in words why it is not known."""

from __future__ import annotations

import math

import pytest
from hand_flights import flight, manoeuvre
from hand_flights import summary as flight_summary
from msgspec.structs import replace

from yawid.answers.damper_report import Mix
from yawid.answers.reasons import Reason, Verdict
from yawid.answers.run_summary import Bare, Value
from yawid.damper.autopilots import AUTOPILOTS
from yawid.damper.mix import mix_of


def told(bare: Bare | None, flown: float | None = 0.5, unit: float = 1.0, name="ardupilot") -> Mix:
    run = replace(flight_summary([manoeuvre(1)], flight(used=[1])), bare=bare)
    return mix_of(run, AUTOPILOTS[name], flown, unit)


def known(value: float, std: float) -> Bare:
    derivatives = {"N_delta_a": Value(0.3, 0.01), "N_delta_r": Value(1.5, 0.01)}
    return Bare(
        rudder_mix=Value(value, std), derivatives=derivatives, airspeed_m_s=22.0, used=[1],
        verdict=Verdict(usable=True, reasons=[]),
    )  # fmt: skip


def test_the_mix_is_given_in_parts_of_the_travel_next_to_the_one_flown() -> None:
    found = told(known(0.3, 0.05))

    assert (found.parameter, found.flown, found.value, found.std) == ("KFF_RDDRMIX", 0.5, 0.3, 0.05)
    assert "KFF_RDDRMIX 0.30 rolls" in found.text
    assert "flown 0.5" in found.text
    # A rudder in rad with 30 degrees of travel.
    in_rad = told(known(0.3 * math.radians(30.0), 0.05 * math.radians(30.0)), None,
                  math.radians(30.0), "px4")  # fmt: skip
    assert in_rad.parameter == "FW_RLL_TO_YAW_FF"
    assert in_rad.value == pytest.approx(0.3)
    assert in_rad.std == pytest.approx(0.05)
    assert "an unknown mix" in in_rad.text


def test_a_mix_beyond_the_parameters_limits_is_held_in_them() -> None:
    assert told(known(-0.1, 0.05)).text.startswith("Leave KFF_RDDRMIX at 0 (found -0.10")
    assert "KFF_RDDRMIX 1.00 rolls" in told(known(1.6, 0.1)).text


def test_without_the_bare_airframe_it_is_refused_in_words() -> None:
    said = Reason("bare_unknown", "the aileron does not move", weight="warning")
    verdict = Verdict(usable=False, reasons=[said])
    unknown = told(Bare(used=[1], verdict=verdict))

    assert told(None).value is None
    assert "--lateral auto" in told(None).text
    assert unknown.value is None
    assert "the aileron does not move" in unknown.text
    wide = told(known(0.3, 0.2))
    assert wide.value is None
    assert "0.3 ± 0.2" in wide.text
