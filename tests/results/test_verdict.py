"""Each reason has a case in which it speaks and one in which it keeps silent."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from flightlog import finished, fly, summarised
from hypothesis import given
from hypothesis import strategies as st
from places import REPLAY_LOGS

from yawid.blocks import Status
from yawid.config.run import RunConfig
from yawid.estimation.methods import METHODS
from yawid.results.judge_estimate import (
    Evidence,
    _by_effect,
    agreement_reasons,
    estimate_reasons,
)
from yawid.results.reasons import KINDS, Reason, Verdict

GOOD = Evidence(
    status=Status.TRACKING,
    updates=500,
    dutch_roll=np.array([2.4, 0.03, 0.2, 0.01]),
    total_std=np.array([0.05, 0.02]),
    next_moves=np.array([0.02, 0.005]),
    rate_moves=np.full(2, math.nan),
    whiteness_p=0.5,
    autocorrelation=0.05,
    spr_margin=0.3,
    early_response=0.3,
    simulation_pct=80.0,
    held_back_pct=75.0,
    before=np.array([2.38, 0.21]),
)
MUCH, LITTLE = np.array([0.06, 0.0]), np.array([0.02, 0.009])
"""How far a structure may move wn 2.4 and zeta: beyond total sigma or 1 %, and within both."""
COLOURED = {"whiteness_p": 1e-5, "autocorrelation": 0.3}


def ids(reasons) -> set[str]:
    return {reason.id for reason in reasons}


def evidence(**changes) -> Evidence:
    return replace(GOOD, **changes)


def test_the_first_fatal_reason_in_the_contracts_order_decides():
    reasons = [Reason("diverged", ""), Reason("rudder_assumed", ""), Reason("rate_too_low", "")]
    verdict = Verdict.of(reasons)

    assert [r.id for r in verdict.reasons] == ["rate_too_low", "diverged", "rudder_assumed"]
    assert verdict.exit_code == 4
    assert not verdict.usable


def test_warnings_alone_are_usable():
    verdict = Verdict.of([Reason("rudder_assumed", "a"), Reason("rudder_assumed", "b")])

    assert verdict.usable
    assert len(verdict.reasons) == 1


def test_gusts_are_no_poor_fit_where_the_rudder_clearly_drives_the_mode():
    gusts = evidence(simulation_pct=21.0, held_back_pct=-5.0)

    assert ids(estimate_reasons("rml", gusts)) == {"poor_fit"}
    assert ids(estimate_reasons("rml", gusts, is_driven=True)) == set()
    vague = evidence(simulation_pct=21.0, total_std=np.array([0.2, 0.02]))
    assert ids(estimate_reasons("rml", vague, is_driven=True)) == {"poor_fit", "poorly_known"}
    worse = evidence(simulation_pct=19.0)
    assert ids(estimate_reasons("rml", worse, is_driven=True)) == {"poor_fit"}


SLOW = np.array([2.4, 0.2, 0.2, 0.01])


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({}, set()),
        ({"status": Status.DIVERGED}, {"diverged"}),
        ({"updates": 0}, {"not_excited"}),
        ({"dutch_roll": np.full(4, np.nan)}, {"not_converged"}),
        # The total sigma says how well it is known, whatever noise alone would allow.
        ({"total_std": np.array([0.25, 0.02])}, {"not_converged"}),
        ({"total_std": np.array([0.05, 0.16])}, {"not_converged"}),
        ({"total_std": np.array([np.nan, 0.02])}, {"not_converged"}),
        ({"total_std": np.array([0.23, 0.14])}, {"poorly_known"}),
        ({"total_std": np.array([0.121, 0.02])}, {"poorly_known"}),  # wn is 2.4: 5.04 %
        ({"total_std": np.array([0.119, 0.14])}, set()),
        (
            {"early_response": -0.3, "total_std": np.array([0.2, 0.1])},
            {"wrong_sign", "poorly_known"},
        ),
        ({"early_response": -0.3}, {"wrong_sign"}),
        ({"early_response": -0.3, "before": np.array([1.9, 0.21])}, {"not_converged"}),
        ({"simulation_pct": -20.0}, {"poor_fit"}),
        ({"simulation_pct": 39.0}, {"poor_fit"}),
        ({"simulation_pct": 41.0, "held_back_pct": 31.0}, set()),
        ({"held_back_pct": 29.0}, {"poor_fit"}),
        ({"held_back_pct": math.nan}, set()),  # too short a record to hold anything back
        ({"before": np.array([1.9, 0.21])}, {"not_converged"}),
        ({"before": np.array([2.22, 0.21])}, set()),  # beyond 3 sigma, within 8 %
        ({"before": np.array([1.9, 0.21]), "dutch_roll": SLOW}, set()),  # within 3 sigma
        ({"before": np.array([2.4, 0.3])}, {"not_converged"}),
        ({"before": np.full(2, math.nan)}, set()),
    ],
)
def test_the_estimate_itself_is_judged(changes, expected):
    assert ids(estimate_reasons("els", evidence(**changes))) == expected


@pytest.mark.parametrize(
    ("moves", "is_worth_a_word"),
    [
        ([0.02, 0.009], False),
        ([0.03, 0.0], True),  # beyond 1 % of wn, within total sigma
        ([0.0, 0.015], True),  # beyond .01 of zeta, within total sigma
        ([math.nan, math.nan], True),
    ],
)
def test_a_move_of_one_percent_is_worth_a_word_and_so_is_one_that_nobody_knows(
    moves: list[float], is_worth_a_word: bool
):
    assert GOOD.matters(np.array(moves)) == is_worth_a_word


@given(
    wn=st.floats(0.5, 30.0),
    totals=st.tuples(st.floats(1e-4, 1.0), st.floats(1e-4, 1.0)),
    moves=st.tuples(st.floats(0.0, 1.0), st.floats(0.0, 1.0)),
)
def test_what_is_worth_a_word_is_beyond_the_total_sigma_or_one_percent(wn, totals, moves):
    found = evidence(dutch_roll=np.array([wn, 0.1, 0.2, 0.1]), total_std=np.array(totals))

    beyond_sigma = moves[0] > totals[0] or moves[1] > totals[1]
    beyond_percent = moves[0] > 0.01 * wn or moves[1] > 0.01
    assert found.matters(np.array(moves)) == (beyond_sigma or beyond_percent)


@pytest.mark.parametrize(
    ("changes", "is_said"),
    [
        ({"next_moves": MUCH}, True),
        ({"next_moves": np.full(2, math.nan)}, True),  # no richer structure found the mode
        ({"next_moves": LITTLE}, False),
        ({"next_moves": MUCH, "autocorrelation": 0.09}, False),  # a long record fails any test
        ({"next_moves": MUCH, "whiteness_p": 0.02}, False),  # a short one has it by chance
        ({"next_moves": MUCH, "whiteness_p": math.nan}, False),
        ({"next_moves": MUCH, "autocorrelation": math.nan}, False),
        ({"next_moves": MUCH, "whiteness_p": 0.0}, True),  # too small for a float
    ],
)
def test_residuals_are_coloured_by_their_size_and_by_what_a_richer_model_makes_of_it(
    changes, is_said: bool
):
    found = estimate_reasons("rml", evidence(**(COLOURED | changes)))
    assert ids(found) == ({"coloured_residuals"} if is_said else set())


def test_coloured_residuals_say_how_much_they_could_matter():
    (reason,) = estimate_reasons("rml", evidence(**COLOURED, next_moves=np.array([0.06, 0.031])))

    assert "(autocorrelation 0.30)" in reason.text
    assert reason.text.endswith(
        "one with more parameters moves wn by about 2.5 % and zeta by 0.031"
    )
    (unknown,) = estimate_reasons("rml", evidence(**COLOURED, next_moves=np.full(2, math.nan)))
    assert unknown.text.endswith("one with more parameters moves wn and zeta by an unknown amount")


def by_effect(id_: str, **changes) -> list[str]:
    reasons = iter([Reason(id_, "so it is")])
    return [reason.text for reason in _by_effect(reasons, evidence(**changes))]


def test_a_low_rate_and_a_closed_loop_are_said_where_they_matter_and_with_how_much():
    """Each by its own effect: the rate's, and a richer model's"""
    assert by_effect("rate_low", rate_moves=LITTLE, next_moves=MUCH) == []
    assert by_effect("closed_loop", rate_moves=MUCH, next_moves=LITTLE) == []
    (rate,) = by_effect("rate_low", rate_moves=MUCH, next_moves=LITTLE)
    assert rate == ("so it is; a higher rate moves wn by about 2.5 % and zeta by 0.000")
    (loop,) = by_effect("closed_loop", rate_moves=LITTLE, next_moves=MUCH)
    assert (
        loop == "so it is; a model with more parameters moves wn by about 2.5 % and zeta by 0.000"
    )


def test_what_makes_an_answer_unusable_is_said_whatever_its_effect():
    assert by_effect("rate_too_low", rate_moves=LITTLE, next_moves=LITTLE) == ["so it is"]


def against(wn: float, zeta: float, **changes) -> list[Reason]:
    """What ELS beside RML's 2.4 and .2 says against it"""
    rml = evidence(dutch_roll=np.array([2.4, 0.02, 0.20, 0.01]), **changes)
    els = evidence(dutch_roll=np.array([wn, 0.02, zeta, 0.01]))
    return list(agreement_reasons({"els": els, "rml": rml}, {}, "rml"))


def test_disagreement_beyond_three_sigma_and_five_percent_is_said():
    assert against(2.42, 0.20) == []
    assert against(2.49, 0.20) == []  # beyond 3 sigma, within 5 %
    assert ids(against(2.60, 0.20)) == {"els_rml_disagree"}
    assert ids(against(2.42, 0.30)) == {"els_rml_disagree"}


def test_methods_that_differ_by_less_than_the_total_sigma_do_not_disagree():
    assert against(2.60, 0.20, total_std=np.array([0.21, 0.02])) == []
    (reason,) = against(2.60, 0.20, total_std=np.array([0.15, 0.02]))
    assert reason.text == (
        "wn is 2.6 by ELS and 2.4 by RML, with a total sigma of 0.15: they differ by 8 %, "
        "so the noise model matters"
    )


@pytest.mark.parametrize("margin", [-0.1, 0.0, math.nan])
def test_an_els_that_need_not_lead_to_the_truth_says_nothing_against_rml(margin: float):
    """1/C - 1/2 not positive real: what it says is of itself; RML beside ELS says what it says"""
    far = evidence(dutch_roll=np.array([3.0, 0.02, 0.2, 0.01]), spr_margin=margin)
    pair = {"els": far, "rml": GOOD}

    assert list(agreement_reasons(pair, {}, "rml")) == []
    assert ids(agreement_reasons(pair, {}, "els")) == {"els_rml_disagree"}


def test_an_rml_that_cannot_be_used_beside_els_is_said_with_its_reason():
    refused = {"rml": [Reason("coloured_residuals", ""), Reason("poor_fit", "it tells 3 %")]}

    (reason,) = agreement_reasons({"els": GOOD, "rml": GOOD}, refused, "els")

    assert reason.id == "els_rml_disagree"
    assert reason.text == "RML, which checks the answer, cannot be used (poor_fit: it tells 3 %)"


def test_the_answer_is_compared_with_each_method_that_checks_it(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(METHODS, "oe", replace(METHODS["rml"], checked_by=("rml", "els")))
    far, further = (evidence(dutch_roll=np.array([wn, 0.02, 0.2, 0.01])) for wn in (3.0, 4.0))

    reasons = agreement_reasons({"oe": GOOD, "rml": far, "els": further}, {}, "oe")

    said = [reason.text.split(",")[0] for reason in reasons]
    assert said == ["wn is 3 by RML and 2.4 by OE", "wn is 4 by ELS and 2.4 by OE"]
    assert list(agreement_reasons({"oe": GOOD, "rml": GOOD}, {}, "oe")) == []


def test_an_els_that_cannot_be_used_says_nothing_against_rml():
    refused = {"els": [Reason("poor_fit", "it tells 3 %")]}
    assert list(agreement_reasons({"els": GOOD, "rml": GOOD}, refused, "rml")) == []
    assert list(agreement_reasons({"rml": GOOD}, {}, "rml")) == []


def test_where_els_cannot_be_used_and_rml_can_rml_answers():
    config = RunConfig(output="yaw", manoeuvres="off")

    summary, verdict = summarised(REPLAY_LOGS / "c172p_3211" / "log.tlog", config)

    assert verdict.usable
    assert summary.verdict.method == "rml"
    assert summary.estimates["rml"].dutch_roll.wn_rad_s == pytest.approx(2.425, rel=0.01)
    assert "els_rml_disagree" not in ids(verdict.reasons)


def test_a_reversed_servo_is_a_warning_in_the_whole_run():
    def run(sign: int) -> set[str]:
        rng = np.random.default_rng(4)
        levels = rng.choice([-150, 150], 200)
        state = np.zeros(2)
        rates = []
        for i in range(3000):
            u = levels[i // 30] / 400
            state = state + 0.02 * np.array([state[1], u - 6.25 * state[0] - 1.0 * state[1]])
            rates.append(5.0 * state[0] + 4.0 * state[1])
        log = fly(
            lambda t: rates[min(round(t / 0.02), 2999)],
            lambda t: int(1500 + sign * levels[min(int(t / 0.6), 199)]),
            60.0,
        )
        summary, _ = finished(log.data, RunConfig(rate=10.0))
        return {reason.id for reason in summary.verdict.reasons}

    assert "wrong_sign" not in run(+1)
    assert "wrong_sign" in run(-1)


@pytest.mark.parametrize(
    ("changes", "said", "unsaid"),
    [
        ({"simulation_pct": 20.0}, "at least 40 % is needed; turns or gusts may", "30"),
        ({"held_back_pct": 10.0}, "at least 30 % is needed; the rudder rested there", "gusts"),
        (
            {"simulation_pct": 20.0, "held_back_pct": 10.0},
            "at least 40 and 30 % are needed",
            "is n",
        ),
    ],
)
def test_a_poor_fit_names_the_limit_that_it_misses_and_a_cause_that_fits(changes, said, unsaid):
    (found,) = estimate_reasons("els", evidence(**changes))

    assert found.id == "poor_fit"
    assert said in found.text
    assert unsaid not in found.text


def test_a_record_has_no_servo_that_could_be_reversed():
    turned = evidence(early_response=-0.3)
    (found,) = estimate_reasons("els", turned, only_sign="nose-left")
    assert "--rudder-sign nose-left is wrong" in found.text
    assert "servo" not in found.text
    (found,) = estimate_reasons("els", turned)
    assert "the servo is reversed or" in found.text


def test_what_to_do_about_a_wrong_sign_does_not_name_the_sign_that_may_stand_there_already():
    assert "nose-left" not in KINDS["wrong_sign"].now
