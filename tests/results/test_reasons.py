"""One table holds every reason; each fits what was found, and says what to do now."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest
from hand_flights import four_of_a_flight
from hypothesis import given
from hypothesis import strategies as st

from yawid.answers.heard import VehicleSeen
from yawid.answers.reasons import KINDS, Reason, Verdict
from yawid.quantities.vehicles import ARDUPILOT, PX4
from yawid.results.advice import advised, with_remedies
from yawid.results.judge_samples import changed_rates, closeness, message_rate_reasons

CONTRACT = {
    "interrupted": 130,
    "no_vehicle": 3, "no_rudder": 3, "no_yaw": 3,
    "rate_too_low": 4,
    "not_in_command": 5, "not_excited": 5, "mixed_rudder": 5, "collinear_inputs": 5,
    "mode_not_driven": 5, "not_converged": 5, "poor_fit": 5,
    "manoeuvres_disagree": 5, "ordinary_unknown": 5,
}  # fmt: skip
WARNINGS = {
    "rudder_assumed", "unit_assumed", "channel_stand_in", "disarmed", "poorly_known",
    "saturated", "airspeed_changed", "airspeed_implausible",
    "wrong_sign", "closed_loop", "repeated",
    "rate_changed", "rate_low", "lag_differs", "airframe_changes", "bare_unknown",
    "ordinary_disagrees", "not_proportional",
}  # fmt: skip


def test_the_table_is_the_contracts_in_its_order():
    fatal = {kind.id: kind.exit_code for kind in KINDS.values() if kind.exit_code}

    assert list(fatal.items()) == list(CONTRACT.items())
    assert KINDS.keys() - fatal.keys() == WARNINGS


def test_every_reason_says_what_to_do_and_none_names_orders_a_band_or_an_estimator():
    """For none of these changes a verdict."""
    words = {"--orders", "orders", "--band", "nc", "RML", "ELS"}
    for kind in KINDS.values():
        reason = Reason(kind.id, "so it was", kind.now)
        assert kind.now.endswith(".")
        assert (reason.to_do, reason.weight) == (kind.now, kind.weight)
        assert not words & {*kind.now.split(), *kind.record.split()}, kind.id


@pytest.mark.parametrize(
    ("given", "stand", "code"),
    [
        (list(KINDS)[::-1], list(CONTRACT), 130),
        (["poor_fit", "rudder_assumed", "rate_too_low"],
         ["rate_too_low", "poor_fit", "rudder_assumed"], 4),
        (["rudder_assumed", "rudder_assumed"], ["rudder_assumed"], 0),
    ],
)  # fmt: skip
def test_reasons_stand_once_in_the_contracts_order_and_the_first_fatal_one_decides(
    given: list[str], stand: list[str], code: int
):
    verdict = Verdict.of([Reason(id_, f"{i}") for i, id_ in enumerate(given)])

    assert [r.id for r in verdict.reasons][: len(CONTRACT)] == stand
    assert (verdict.exit_code, verdict.usable) == (code, code == 0)
    assert code or verdict.reasons[0].text == "0"


def test_a_fatal_reason_stands_before_a_warning_of_the_same_kind():
    warning = Reason("manoeuvres_disagree", "a little", weight="warning")

    assert Verdict.of([warning]).usable
    assert Verdict.of([warning, Reason("manoeuvres_disagree", "much")]).why == "manoeuvres_disagree"


def test_a_reason_of_a_newer_version_is_fatal_where_it_says_so():
    known = {"id": "of_2030", "text": "so it was", "weight": "fatal"}
    verdict = Verdict.of([msgspec.convert(known, Reason), Reason("no_yaw", "")])

    assert [reason.id for reason in verdict.fatal] == ["no_yaw", "of_2030"]
    assert verdict.fatal[1].exit_code == 5


def test_what_a_reason_says_itself_is_not_said_again():
    rate = KINDS["rate_changed"].now
    assert Reason("rate_changed", f"yaw came slower: {rate[0].lower()}{rate[1:]}", rate).to_do == ""
    assert Reason("rate_changed", "yaw came slower", rate).to_do == rate


PLANE = 1


def remedies(reason: Reason, autopilot: int = ARDUPILOT, flown: int = 0) -> str | None:
    vehicle = VehicleSeen(1, 1, PLANE, autopilot)
    return with_remedies(Verdict.of([reason]), vehicle, flown).next


@pytest.mark.parametrize(
    ("reason", "given", "says"),
    [
        (Reason("not_converged", ""), {"flown": 1}, KINDS["not_converged"].now),
        (Reason("not_converged", ""), {"flown": 3}, "The rudder moved enough: choose"),
        (Reason("rate_too_low", ""), {}, "SRn_EXTRA1 = 25"),
        (Reason("rate_too_low", ""), {"autopilot": PX4}, "mavlink stream -d"),
        (Reason("no_yaw", "none came", "Turn it on."), {}, "Turn it on."),
    ],
)
def test_the_next_step_fits_the_reason_the_autopilot_and_what_was_flown(
    reason: Reason, given: dict[str, int], says: str
) -> None:
    assert says in str(remedies(reason, **given))


def test_the_next_step_is_that_of_the_first_fatal_reason() -> None:
    said = [Reason("saturated", ""), Reason("no_yaw", ""), Reason("poor_fit", "")]

    assert with_remedies(Verdict.of(said), None, 0).next == KINDS["no_yaw"].now
    assert with_remedies(Verdict.of(said[:1]), None, 0).next is None


def test_every_verdict_that_is_not_usable_says_what_to_do_next_and_no_other() -> None:
    run = advised(four_of_a_flight())
    verdicts = [run.deciding, run.flight.verdict, *(each.verdict for each in run.manoeuvres)]

    assert len({each.usable for each in verdicts}) == 2
    assert [each.next is None for each in verdicts] == [each.usable for each in verdicts]
    assert all(reason.remedy for each in verdicts for reason in each.reasons)


def ids(reasons) -> set[str]:
    return {reason.id for reason in reasons}


@pytest.mark.parametrize(
    ("yaw", "rudder", "expected"),
    [
        (50.0, 50.0, set()),
        (4.0, 50.0, {"rate_too_low"}),
        (50.0, 4.95, {"rate_low"}),  # a stream of 5 Hz has 4.95
        (50.0, 8.0, {"rate_low"}),
        (10.0, 12.0, set()),
    ],
)
def test_message_rates_are_judged_by_the_slower_of_the_two(yaw, rudder, expected):
    assert ids(message_rate_reasons(yaw, rudder)) == expected


def test_a_rate_that_changes_after_the_first_seconds_is_said():
    assert ids(changed_rates(1.0, 10.0, 4.0, 10.0)) == {"rate_changed"}
    assert ids(changed_rates(10.0, 10.0, 9.0, 11.0)) == set()
    assert ids(changed_rates(10.0, 10.0, math.nan, math.nan)) == set()


@given(scale=st.floats(1e-3, 1e3), offset=st.floats(-1.0, 1.0), held=st.integers(0, 900))
def test_closeness_does_not_depend_on_units_trims_or_held_samples(scale, offset, held):
    rng = np.random.default_rng(8)
    a, noise = rng.standard_normal((2, 1000))
    b = 0.7 * a + noise
    holes = a.copy()
    holes[held : held + 50] = np.nan

    whole = closeness(a, b)
    assert 0.4 < whole < 0.8
    assert closeness(a, offset + scale * b) == pytest.approx(whole, rel=1e-6)
    assert closeness(b, a) == pytest.approx(whole, rel=1e-9)
    assert closeness(holes, b) == pytest.approx(whole, abs=0.05)
