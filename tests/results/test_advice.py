"""What to do now fits the vehicle, and what the log already holds."""

from __future__ import annotations

import pytest
from hand_flights import forty, four_of_a_flight, summary
from msgspec.structs import replace

from yawid.answers.run_summary import ReasonSummary, VehicleSeen
from yawid.results.advice import to_do
from yawid.results.reasons import ARDUPILOT, KINDS, PX4

PLANE, QUADROTOR = 1, 2


def vehicle(kind: int, autopilot: int = ARDUPILOT) -> VehicleSeen:
    return VehicleSeen(1, 1, kind, autopilot)


def reason(id_: str, text: str = "so it was") -> ReasonSummary:
    return ReasonSummary(id_, "fatal", text)


def test_nobody_names_a_channel_to_a_quadrotor() -> None:
    run = summary(None, None)
    said = [to_do(reason("no_rudder"), replace(run, vehicle=vehicle(kind))) for kind in
            (QUADROTOR, PLANE)]  # fmt: skip

    assert said == ["Use a log of an aircraft that has a rudder.", KINDS["no_rudder"].now]


def test_more_doublets_are_no_advice_to_a_log_full_of_them() -> None:
    few = replace(four_of_a_flight(), manoeuvres=(four_of_a_flight().manoeuvres or [])[:1])

    assert to_do(reason("not_converged"), few) == KINDS["not_converged"].now
    assert to_do(reason("not_converged"), forty()).startswith("The rudder moved enough: choose")


@pytest.mark.parametrize(
    ("autopilot", "says"), [(ARDUPILOT, "SRn_EXTRA1 = 25"), (PX4, "mavlink stream -d")]
)
def test_a_rate_too_low_is_raised_by_the_autopilots_own_names(autopilot: int, says: str) -> None:
    run = replace(four_of_a_flight(), vehicle=vehicle(PLANE, autopilot))

    assert says in to_do(reason("rate_too_low"), run)


def test_what_a_reason_says_itself_is_not_said_again() -> None:
    run = four_of_a_flight()

    assert to_do(reason("rate_changed", "yaw came slower: choose the rate with --rate"), run) == ""
    assert to_do(reason("of_a_newer_version"), run) == ""
