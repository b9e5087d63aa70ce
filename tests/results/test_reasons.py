"""One table holds every reason; whoever names one, names a row of it."""

from __future__ import annotations

import ast

import pytest
from places import SRC

from yawid.answers.run_summary import ReasonSummary
from yawid.report.html import first_screen, prose
from yawid.results.reasons import KINDS, Reason, Verdict
from yawid.sinks.answers import Card

CONTRACT = {
    "interrupted": 130,
    "no_vehicle": 3, "no_rudder": 3, "no_yaw": 3,
    "rate_too_low": 4,
    "not_in_command": 5, "not_excited": 5, "mixed_rudder": 5, "collinear_inputs": 5,
    "mode_not_driven": 5, "not_converged": 5, "poor_fit": 5, "diverged": 5, "turn_dominated": 5,
    "manoeuvres_disagree": 5,
}  # fmt: skip
WARNINGS = {
    "rudder_assumed", "unit_assumed", "channel_stand_in", "disarmed", "els_rml_disagree",
    "coloured_residuals", "poorly_known", "saturated", "airspeed_changed", "airspeed_implausible",
    "wrong_sign", "closed_loop", "repeated",
    "rate_changed", "rate_low", "lag_differs", "airframe_changes", "bare_unknown",
}  # fmt: skip


def test_the_table_is_the_contracts_in_its_order():
    fatal = {kind.id: kind.exit_code for kind in KINDS.values() if kind.exit_code}

    assert list(fatal.items()) == list(CONTRACT.items())
    assert KINDS.keys() - fatal.keys() == WARNINGS


@pytest.mark.parametrize("kind", KINDS.values(), ids=lambda kind: kind.id)
def test_every_reason_says_what_to_do_in_the_report(kind):
    reason = ReasonSummary(kind.id, kind.weight, "so it was")
    card = Card("Can I use it?", "No", "", ())
    page = first_screen("a.tlog", "", "", [card], [(reason, kind.now)])

    assert kind.now.endswith(".")
    assert f'<span class="advice">{prose(kind.now)}</span>' in page
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
    }

    assert len(given) > 10
    assert given <= KINDS.keys()


def test_the_first_fatal_reason_of_the_table_decides_the_code():
    ids = list(KINDS)
    verdict = Verdict.of([Reason(id_, "") for id_ in reversed(ids)])

    assert [r.id for r in verdict.reasons][: len(CONTRACT)] == list(CONTRACT)
    assert verdict.exit_code == 130
    assert not verdict.usable


def test_no_advice_names_the_estimator_to_take_for_the_verdict_does():
    assert not [kind.id for kind in KINDS.values() if "RML" in kind.now or "ELS" in kind.now]
