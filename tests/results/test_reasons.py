"""One table holds every reason; whoever names one, names a row of it."""

from __future__ import annotations

import ast

import msgspec
import pytest
from places import SRC

from yawid.answers.reasons import KINDS, Reason, Verdict

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


@pytest.mark.parametrize("kind", KINDS.values(), ids=lambda kind: kind.id)
def test_every_reason_says_what_to_do(kind):
    reason = Reason(kind.id, "so it was", kind.now)

    assert kind.now.endswith(".")
    assert (reason.to_do, reason.weight) == (kind.now, kind.weight)
    assert kind.origin in ("run", "log", "samples", "estimate")


def test_every_reason_given_in_the_code_is_in_the_table():
    given = {
        node.args[0].value
        for path in SRC.rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Call)
        and isinstance(node.func, ast.Name)
        and node.func.id == "Reason"
        and isinstance(node.args[0], ast.Constant)
        and not any(keyword.arg == "weight" for keyword in node.keywords)  # a damper's own
    }

    assert len(given) > 10
    assert given <= KINDS.keys()


def test_the_first_fatal_reason_of_the_table_decides_the_code():
    ids = list(KINDS)
    verdict = Verdict.of([Reason(id_, "") for id_ in reversed(ids)])

    assert [r.id for r in verdict.reasons][: len(CONTRACT)] == list(CONTRACT)
    assert verdict.exit_code == 130
    assert not verdict.usable


def test_the_first_fatal_reason_in_the_contracts_order_decides():
    reasons = [Reason("poor_fit", ""), Reason("rudder_assumed", ""), Reason("rate_too_low", "")]
    verdict = Verdict.of(reasons)

    assert [r.id for r in verdict.reasons] == ["rate_too_low", "poor_fit", "rudder_assumed"]
    assert verdict.exit_code == 4
    assert not verdict.usable


def test_warnings_alone_are_usable_and_each_stands_once():
    verdict = Verdict.of([Reason("rudder_assumed", "a"), Reason("rudder_assumed", "b")])

    assert verdict.usable
    assert [reason.text for reason in verdict.reasons] == ["a"]


def test_a_fatal_reason_stands_before_a_warning_of_the_same_kind():
    warning = Reason("manoeuvres_disagree", "a little", weight="warning")

    assert Verdict.of([warning]).usable
    assert Verdict.of([warning, Reason("manoeuvres_disagree", "much")]).why == "manoeuvres_disagree"


def test_a_reason_and_a_verdict_come_back_from_json_as_they_were():
    said = [Reason("no_yaw", "none came", "Ask for it."), Reason("saturated", "at its stops")]
    verdict = Verdict.of(said, "ct")

    assert msgspec.convert(verdict.to_json(), Verdict) == verdict
    assert verdict.to_json()["reasons"][1] == {
        "id": "saturated", "text": "at its stops", "weight": "warning",
    }  # fmt: skip


def test_a_reason_of_a_newer_version_is_fatal_where_it_says_so():
    known = {"id": "of_2030", "text": "so it was", "weight": "fatal"}
    verdict = Verdict.of([msgspec.convert(known, Reason), Reason("no_yaw", "")])

    assert [reason.id for reason in verdict.fatal] == ["no_yaw", "of_2030"]
    assert verdict.fatal[1].exit_code == 5


def test_what_a_reason_says_itself_is_not_said_again():
    rate = KINDS["rate_changed"].now
    assert Reason("rate_changed", f"yaw came slower: {rate[0].lower()}{rate[1:]}", rate).to_do == ""
    assert Reason("rate_changed", "yaw came slower", rate).to_do == rate


def test_no_advice_names_orders_or_a_band_for_they_change_no_verdict():
    words = ("--orders", "yawid orders", "--band", "nc")
    said = [text for kind in KINDS.values() for text in (kind.now, kind.record)]

    assert [text for text in said if any(word in text.split() for word in words)] == []


def test_no_advice_names_the_estimator_to_take_for_the_verdict_does():
    assert not [kind.id for kind in KINDS.values() if "RML" in kind.now or "ELS" in kind.now]
