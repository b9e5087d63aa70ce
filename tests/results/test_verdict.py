"""Each reason has a case in which it speaks and one in which it keeps silent."""

from __future__ import annotations

import math

import numpy as np
import pytest
from flightlog import finished, fly, summarised
from hypothesis import given
from hypothesis import strategies as st
from places import REPLAY_LOGS

from yawid.blocks import Status
from yawid.config.run import RunConfig
from yawid.estimation.bank import History
from yawid.results.judge_estimate import Evidence, agreement_reasons, estimate_reasons
from yawid.results.judge_samples import (
    changed_rates,
    closeness,
    damper_reasons,
    feedback_reasons,
    flight_reasons,
    input_reasons,
    rate_reasons,
)
from yawid.results.reasons import KINDS, Reason, Verdict

BEFORE = np.array([2.38, 0.21])
GOOD = Evidence(
    Status.TRACKING, 500, np.array([2.4, 0.05, 0.2, 0.02]), 0.5, 0.3, 80.0, 75.0, BEFORE, 0.5
)


def ids(reasons) -> set[str]:
    return {reason.id for reason in reasons}


def evidence(**changes) -> Evidence:
    values = {name: getattr(GOOD, name) for name in GOOD.__slots__} | changes
    return Evidence(**values)


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


@pytest.mark.parametrize(
    ("yaw", "rudder", "wn", "expected"),
    [
        (50.0, 50.0, 2.4, set()),
        (4.0, 50.0, 2.4, {"rate_too_low"}),
        (50.0, 4.95, 2.4, {"rate_low"}),
        (50.0, 8.0, 2.4, {"rate_low"}),
        (12.0, 12.0, 22.0, {"rate_too_low"}),
        (50.0, 50.0, 30.0, {"rate_low"}),  # the grid at 20 Hz is 4.2 times the mode
        (50.0, 50.0, 12.9, {"rate_low"}),
        (50.0, 50.0, 12.3, set()),
        (50.0, 50.0, 32.0, {"rate_too_low"}),
        (50.0, 50.0, math.nan, set()),
    ],
)
def test_rates_are_judged_by_themselves_and_by_the_mode_found(yaw, rudder, wn, expected):
    dutch_roll = np.array([wn, 0.1, 0.2, 0.01])

    assert ids(rate_reasons(yaw, rudder, min(20.0, yaw, rudder), dutch_roll)) == expected


def test_a_mode_that_is_not_known_condemns_no_rate():
    assert ids(rate_reasons(12.0, 12.0, 12.0, np.array([22.0, 9.0, 0.2, 0.3]))) == set()


def test_a_poor_ratio_names_the_rate_that_can_be_had():
    (reason,) = rate_reasons(50.0, 25.0, 20.0, np.array([15.0, 0.1, 0.2, 0.01]))

    assert "8.4 times" in reason.text
    assert "--rate 25" in reason.text


def test_a_rate_that_changes_after_the_first_seconds_is_said():
    assert ids(changed_rates(1.0, 10.0, 4.0, 10.0)) == {"rate_changed"}
    assert ids(changed_rates(10.0, 10.0, 9.0, 11.0)) == set()
    assert ids(changed_rates(10.0, 10.0, math.nan, math.nan)) == set()


def judged_inputs(u: np.ndarray, travel_unit: float = 1.0) -> set[str]:
    names = ("rudder", "aileron")[: u.shape[1]]
    return ids(input_reasons(names, u, travel_unit))


def test_inputs_must_be_there_and_not_move_together_nor_at_their_stops():
    rng = np.random.default_rng(1)
    u = rng.uniform(-0.3, 0.3, (500, 2))
    rudder = u[:, :1]

    assert judged_inputs(u) == set()
    assert judged_inputs(np.full((5, 1), np.nan)) == {"not_excited"}
    together = np.column_stack([u[:, 0], 2.0 * u[:, 0] + 1e-3 * u[:, 1]])
    assert judged_inputs(together) == {"collinear_inputs"}
    at_stops = np.where(rudder > 0.0, 1.0, rudder)
    assert judged_inputs(at_stops) == {"saturated"}


def test_collinear_inputs_come_with_correlation_and_condition_number():
    rng = np.random.default_rng(1)
    a, b = rng.standard_normal((2, 5000))

    def found(r: float) -> list[Reason]:
        u = 0.1 * np.column_stack([a, r * a + math.sqrt(1.0 - r * r) * b])
        return list(input_reasons(("rudder", "aileron"), u, 1.0))

    assert found(0.99) == []
    (reason,) = found(-0.999)
    assert "correlation -0.999" in reason.text
    number = float(reason.text.partition("lags ")[2].partition(")")[0])
    assert number == pytest.approx(math.sqrt(1.999 / 0.001), rel=0.05)
    assert found(1.0)[0].id == "collinear_inputs"


@pytest.mark.parametrize("delay", [1, 2])
def test_an_aileron_that_follows_the_rudder_later_is_collinear_all_the_same(delay):
    rng = np.random.default_rng(7)
    rudder = 0.2 * np.repeat(rng.choice([-1.0, 0.0, 1.0], 250), 8)
    copy = np.column_stack([rudder, np.roll(rudder, delay)])
    own = np.column_stack([rudder, 0.2 * np.repeat(rng.choice([-1.0, 0.0, 1.0], 250), 8)])

    assert abs(np.corrcoef(copy.T)[0, 1]) < 0.95
    assert judged_inputs(copy) == {"collinear_inputs"}
    assert judged_inputs(own) == set()
    assert judged_inputs(np.column_stack([rudder, np.full(2000, 0.1)])) == set()


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


def history(**changes) -> History:
    rng = np.random.default_rng(2)
    n = 1000
    columns = {
        "u": rng.standard_normal((n, 1)),
        "y": rng.standard_normal(n),
        "roll": rng.standard_normal(n),
        "turn": rng.standard_normal(n),
        "airspeed": np.full(n, 20.0),
        "aileron": np.full(n, np.nan),
        "mode": np.full(n, np.nan),
        "y_hat": {},
    }
    return History(**(columns | changes))


def test_flying_that_hides_the_rudder_is_said():
    base = history()

    assert ids(flight_reasons(base, "keep")) == set()
    turns = history(turn=base.y + 0.5 * base.turn)
    assert ids(flight_reasons(turns, "keep")) == {"turn_dominated"}
    assert ids(flight_reasons(turns, "remove")) == set()
    assert ids(flight_reasons(history(turn=-turns.turn), "keep")) == set()
    faster = history(airspeed=np.linspace(15.0, 25.0, 1000))
    assert ids(flight_reasons(faster, "keep")) == {"airspeed_changed"}
    assert ids(flight_reasons(history(turn=np.full(1000, np.nan)), "keep")) == set()


def test_an_input_that_only_reacts_is_named():
    inputs, base = ("rudder", "aileron"), history()
    free = np.random.default_rng(3).standard_normal(1000)
    damper = -0.5 * base.y + 0.2 * base.roll
    hold = -base.roll - 3.0 * np.diff(base.roll, prepend=np.nan)  # roll and roll rate

    def said(rudder, aileron):
        made = history(u=np.column_stack([rudder, aileron]))
        return [reason.text.split(":")[0] for reason in feedback_reasons(inputs, made)]

    assert said(free, free[::-1]) == []
    assert said(free, np.full(1000, 0.3)) == []
    assert said(0.3 - 1e-16 * np.round(base.y), free) == []  # at trim: nothing but rounding
    assert said(damper, free) == ["yaw rate and roll explain 100 % of the rudder"]
    assert said(free, hold) == ["yaw rate and roll explain 100 % of the aileron"]
    both = "yaw rate and roll explain 100 % of the rudder and 100 % of the aileron"
    assert said(damper, hold) == [both]


def test_what_opposes_the_yaw_and_follows_it_is_a_damper_and_not_the_aircraft():
    assert ids(damper_reasons(0.85, -0.2)) == {"mode_not_driven"}
    assert ids(damper_reasons(0.85, 0.2)) == set()  # a rudder that reacts and turns the nose
    assert ids(damper_reasons(0.6, -0.2)) == set()  # a reversed servo that somebody moves


def test_gusts_are_no_poor_fit_where_the_rudder_clearly_drives_the_mode():
    gusts = evidence(simulation_pct=21.0, held_back_pct=-5.0)

    assert ids(estimate_reasons("rml", gusts)) == {"poor_fit"}
    assert ids(estimate_reasons("rml", gusts, is_driven=True)) == set()
    vague = evidence(simulation_pct=21.0, dutch_roll=np.array([2.4, 0.2, 0.2, 0.02]))
    assert ids(estimate_reasons("rml", vague, is_driven=True)) == {"poor_fit"}
    worse = evidence(simulation_pct=19.0)
    assert ids(estimate_reasons("rml", worse, is_driven=True)) == {"poor_fit"}


def test_a_roll_hold_taken_for_an_input_is_told_apart_from_an_excited_aileron():
    def closed_loop(case):
        inputs = ("rudder", "aileron")
        config = RunConfig(rate=10.0, forgetting=1.0, inputs=inputs, manoeuvres="off")
        reasons = summarised(REPLAY_LOGS / case / "log.tlog", config)[1].reasons
        return [reason.text for reason in reasons if reason.id == "closed_loop"]

    [text] = closed_loop("c172p_3211")
    assert text.startswith("yaw rate and roll explain 99 % of the aileron")
    assert closed_loop("c172p_aileron") == []


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({}, set()),
        ({"status": Status.DIVERGED}, {"diverged"}),
        ({"updates": 0}, {"not_excited"}),
        ({"dutch_roll": np.full(4, np.nan)}, {"not_converged"}),
        ({"dutch_roll": np.array([2.4, 0.25, 0.2, 0.02])}, {"not_converged"}),
        ({"dutch_roll": np.array([2.4, 0.05, 0.2, 0.16])}, {"not_converged"}),
        ({"dutch_roll": np.array([2.4, np.nan, 0.2, 0.02])}, {"not_converged"}),
        ({"whiteness_p": 1e-5}, {"coloured_residuals"}),
        ({"early_response": -0.3}, {"wrong_sign"}),
        ({"early_response": -0.3, "before": np.array([1.9, 0.21])}, {"not_converged"}),
        ({"simulation_pct": -20.0}, {"poor_fit"}),
        ({"simulation_pct": 39.0}, {"poor_fit"}),
        ({"simulation_pct": 41.0, "held_back_pct": 31.0}, set()),
        ({"held_back_pct": 29.0}, {"poor_fit"}),
        ({"held_back_pct": math.nan}, set()),  # too short a record to hold anything back
        ({"before": np.array([1.9, 0.21])}, {"not_converged"}),
        ({"before": np.array([2.27, 0.21])}, set()),  # within 3 sigma
        ({"before": np.array([2.4, 0.3])}, {"not_converged"}),
        ({"before": np.full(2, math.nan)}, set()),
        ({"roll_p": 1e-5}, {"coloured_residuals"}),
        ({"roll_p": math.nan}, set()),
    ],
)
def test_the_estimate_itself_is_judged(changes, expected):
    assert ids(estimate_reasons("els", evidence(**changes))) == expected


def test_disagreement_beyond_three_sigma_and_five_percent_is_said():
    els = evidence(dutch_roll=np.array([2.4, 0.02, 0.20, 0.01]))

    def against(wn: float, zeta: float) -> set[str]:
        rml = evidence(dutch_roll=np.array([wn, 0.02, zeta, 0.01]))
        return ids(agreement_reasons({"els": els, "rml": rml}, {}))

    assert against(2.42, 0.20) == set()
    assert against(2.49, 0.20) == set()  # beyond 3 sigma, within 5 %
    assert against(2.60, 0.20) == {"els_rml_disagree"}
    assert against(2.42, 0.30) == {"els_rml_disagree"}


def test_a_method_that_cannot_be_used_beside_one_that_can_is_said_with_its_reason():
    refused = {"rml": [Reason("coloured_residuals", ""), Reason("poor_fit", "it tells 3 %")]}

    (reason,) = agreement_reasons({"els": GOOD, "rml": GOOD}, refused)

    assert reason.id == "els_rml_disagree"
    assert reason.text == "RML beside it cannot be used (poor_fit: it tells 3 %)"


def test_where_els_cannot_be_used_and_rml_can_rml_answers():
    config = RunConfig(output="yaw", manoeuvres="off")

    summary, verdict = summarised(REPLAY_LOGS / "c172p_3211" / "log.tlog", config)

    assert verdict.usable
    assert summary.verdict.method == "rml"
    assert summary.estimates["rml"].dutch_roll.wn_rad_s == pytest.approx(2.404, rel=0.02)
    texts = {reason.id: reason.text for reason in verdict.reasons}
    assert texts["els_rml_disagree"].startswith("ELS beside it cannot be used (")


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
        ({"simulation_pct": 20.0}, "at least 40 % is needed; turns or gusts", "30"),
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


def test_a_p_value_too_small_for_a_float_is_not_called_zero():
    (found,) = estimate_reasons("els", evidence(whiteness_p=0.0))

    assert found.id == "coloured_residuals"
    assert "p < 1e-300" in found.text


def test_what_to_do_about_a_wrong_sign_does_not_name_the_sign_that_may_stand_there_already():
    assert "nose-left" not in KINDS["wrong_sign"].now
