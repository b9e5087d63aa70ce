"""What to do now fits the vehicle, and what the log already holds."""

from __future__ import annotations

import numpy as np
import pytest
from hand_flights import forty, four_of_a_flight, summary
from msgspec.structs import replace

from yawid.answers.heard import VehicleSeen
from yawid.answers.run_summary import ReasonSummary
from yawid.estimation.bank import SampleHistory
from yawid.estimation.free_run import RudderEffect
from yawid.results.advice import Situation, advised, next_step, remedy, to_do
from yawid.results.judge_rudder import rudder_reasons
from yawid.results.judge_samples import damper_reasons
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


@pytest.mark.parametrize("copy", ["mixed_rudder", "collinear_inputs"])
def test_the_turn_is_not_removed_where_the_rudder_copies_the_aileron(copy: str) -> None:
    turn = reason("turn_dominated")
    situation = Situation(vehicle(PLANE), has_flight=False, moved_enough=False)

    assert "--turn remove" in remedy(turn, [turn], situation)
    assert "--turn remove" not in remedy(turn, [reason(copy), turn], situation)


def test_the_next_step_is_that_of_the_first_fatal_reason() -> None:
    found = [ReasonSummary("saturated", "warning", ""), reason("no_yaw"), reason("diverged")]
    situation = Situation(None, has_flight=False, moved_enough=False)

    assert next_step(found, situation) == KINDS["no_yaw"].now
    assert next_step(found[:1], situation) is None


def test_every_verdict_that_is_not_usable_says_what_to_do_next_and_no_other() -> None:
    run = advised(forty())
    verdicts = [run.verdict, *(each.verdict for each in run.manoeuvres or [])]
    verdicts += [] if run.flight is None else [run.flight.verdict]

    assert len({each.usable for each in verdicts}) == 2
    assert [each.next is None for each in verdicts] == [each.usable for each in verdicts]


def test_advice_fits_what_the_judge_found() -> None:
    situation = Situation(None, has_flight=False, moved_enough=True)
    late = RudderEffect(
        chance=0.0, fit_pct=90.0, without_pct=0.0, shifted_s=4.0, ratio=0.9, excess=10.0
    )
    rates, none = np.random.default_rng(1).standard_normal(100), np.full(100, np.nan)
    opposes = SampleHistory(-rates[:, None], rates, none, none, none, none, none, {})
    damper, shifted = (
        remedy(reason(found.id, found.text), [], situation)
        for found in (*damper_reasons(opposes, 0.9, -1.0), *rudder_reasons(late))
    )

    assert "YAW2SRV_DAMP" in damper
    assert "--rudder" in shifted
