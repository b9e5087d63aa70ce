"""What to do now fits the vehicle, and what the log already holds."""

from __future__ import annotations

import pytest
from hand_flights import four_of_a_flight

from yawid.answers.heard import VehicleSeen
from yawid.answers.reasons import KINDS, Reason, Verdict
from yawid.quantities.vehicles import ARDUPILOT, PX4
from yawid.results.advice import advised, with_remedies

PLANE = 1


def remedies(reason: Reason, autopilot: int = ARDUPILOT, flown: int = 0) -> str | None:
    vehicle = VehicleSeen(1, 1, PLANE, autopilot)
    return with_remedies(Verdict.of([reason]), vehicle, flown).next


def test_more_doublets_are_no_advice_to_a_log_full_of_them() -> None:
    unknown = Reason("not_converged", "sigma of wn is 14 %")

    assert remedies(unknown, flown=1) == KINDS["not_converged"].now
    assert str(remedies(unknown, flown=3)).startswith("The rudder moved enough: choose")


@pytest.mark.parametrize(
    ("autopilot", "says"), [(ARDUPILOT, "SRn_EXTRA1 = 25"), (PX4, "mavlink stream -d")]
)
def test_a_rate_too_low_is_raised_by_the_autopilots_own_names(autopilot: int, says: str) -> None:
    assert says in str(remedies(Reason("rate_too_low", "yaw 3 Hz"), autopilot))


def test_the_remedy_of_what_was_found_wins_over_that_of_its_kind() -> None:
    assert remedies(Reason("no_yaw", "none came", "Turn it on.")) == "Turn it on."


def test_the_next_step_is_that_of_the_first_fatal_reason() -> None:
    said = [Reason("saturated", ""), Reason("no_yaw", ""), Reason("poor_fit", "")]

    assert with_remedies(Verdict.of(said), None, 0).next == KINDS["no_yaw"].now
    assert with_remedies(Verdict.of(said[:1]), None, 0).next is None


def test_every_verdict_that_is_not_usable_says_what_to_do_next_and_no_other() -> None:
    run = advised(four_of_a_flight())
    verdicts = [run.deciding, *(each.verdict for each in run.manoeuvres or [])]
    verdicts += [] if run.flight is None else [run.flight.verdict]

    assert len({each.usable for each in verdicts}) == 2
    assert [each.next is None for each in verdicts] == [each.usable for each in verdicts]
    assert all(reason.remedy for each in verdicts for reason in each.reasons)
