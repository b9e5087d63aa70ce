"""The mix in the autopilot's parameter, or in words why it is not known."""

from __future__ import annotations

import math
from typing import Any

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


UNKNOWN = Reason("bare_unknown", "the aileron does not move", weight="warning")
TRAVEL = math.radians(30.0)


@pytest.mark.parametrize(
    ("bare", "options", "value", "said"),
    [
        (known(0.3, 0.05), {}, 0.3, ("KFF_RDDRMIX 0.30 rolls", "flown 0.5")),
        # A rudder in rad with 30 degrees of travel.
        (
            known(0.3 * TRAVEL, 0.05 * TRAVEL),
            {"flown": None, "unit": TRAVEL, "name": "px4"}, 0.3,
            ("FW_RLL_TO_YAW_FF", "an unknown mix"),
        ),
        (known(-0.1, 0.05), {}, -0.1, ("Leave KFF_RDDRMIX at 0 (found -0.10",)),
        (known(1.6, 0.1), {}, 1.6, ("KFF_RDDRMIX 1.00 rolls",)),
        (None, {}, None, ("--lateral auto",)),
        (
            Bare(used=[1], verdict=Verdict(usable=False, reasons=[UNKNOWN])), {}, None,
            ("the aileron does not move",),
        ),
        (known(0.3, 0.2), {}, None, ("0.3 ± 0.2",)),
    ],
)  # fmt: skip
def test_the_mix_is_given_in_parts_of_the_travel_within_the_parameters_limits_or_refused_in_words(
    bare: Bare | None, options: dict[str, Any], value: float | None, said: tuple[str, ...]
) -> None:
    found = told(bare, **options)

    assert (found.value, found.flown) == (pytest.approx(value), options.get("flown", 0.5))
    assert value is None or found.std == pytest.approx(bare.rudder_mix.std / options.get("unit", 1))
    for each in said:
        assert each in f"{found.parameter}: {found.text}"
