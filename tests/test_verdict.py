"""Each reason has a case in which it speaks and one in which it keeps silent."""

from __future__ import annotations

import math

import numpy as np
import pytest
from flightlog import fly

from yawid.blocks import Status
from yawid.estimation.bank import History
from yawid.pipeline import Pipeline
from yawid.run_config import RunConfig
from yawid.summary import summarise
from yawid.verdict import (
    Reason,
    Verdict,
    changed_rates,
    flight_reasons,
    input_reasons,
    rate_reasons,
)
from yawid.verdict_estimate import Evidence, agreement_reasons, estimate_reasons

BEFORE = np.array([2.38, 0.21])
GOOD = Evidence(Status.TRACKING, 500, np.array([2.4, 0.05, 0.2, 0.02]), 0.5, 0.3, 80.0, BEFORE, 0.5)


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
        (50.0, 50.0, math.nan, set()),
    ],
)
def test_rates_are_judged_by_themselves_and_by_the_mode_found(yaw, rudder, wn, expected):
    dutch_roll = np.array([wn, 0.1, 0.2, 0.01])

    assert ids(rate_reasons(yaw, rudder, min(20.0, yaw, rudder), dutch_roll)) == expected


def test_a_mode_that_is_not_known_condemns_no_rate():
    assert ids(rate_reasons(12.0, 12.0, 12.0, np.array([22.0, 9.0, 0.2, 0.3]))) == set()


def test_a_rate_that_changes_after_the_first_seconds_is_said():
    assert ids(changed_rates(1.0, 10.0, 4.0, 10.0)) == {"rate_changed"}
    assert ids(changed_rates(10.0, 10.0, 9.0, 11.0)) == set()
    assert ids(changed_rates(10.0, 10.0, math.nan, math.nan)) == set()


def test_inputs_must_move_and_not_together():
    rng = np.random.default_rng(1)
    u = rng.uniform(-0.3, 0.3, (500, 2))

    assert ids(input_reasons(("rudder", "aileron"), u, 1.0)) == set()
    assert ids(input_reasons(("rudder",), 0.01 * u, 1.0)) == {"not_excited"}
    assert ids(input_reasons(("rudder",), u, 100.0)) == {"not_excited"}
    assert ids(input_reasons(("rudder",), np.full((5, 1), np.nan), 1.0)) == {"not_excited"}
    together = np.column_stack([u[:, 0], 2.0 * u[:, 0] + 1e-3 * u[:, 1]])
    assert ids(input_reasons(("rudder", "aileron"), together, 1.0)) == {"collinear_inputs"}
    at_stops = np.where(u > 0.0, 1.0, u)
    assert ids(input_reasons(("rudder",), at_stops, 1.0)) == {"saturated"}


def history(**changes) -> History:
    rng = np.random.default_rng(2)
    n = 1000
    columns = {
        "u": rng.standard_normal((n, 1)),
        "y": rng.standard_normal(n),
        "roll": rng.standard_normal(n),
        "turn": rng.standard_normal(n),
        "airspeed": np.full(n, 20.0),
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
    damper = history(u=(-0.5 * base.y + 0.2 * base.roll)[:, None])
    assert ids(flight_reasons(damper, "keep")) == {"closed_loop"}
    assert ids(flight_reasons(history(turn=np.full(1000, np.nan)), "keep")) == set()


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({}, set()),
        ({"status": Status.DIVERGED}, {"diverged"}),
        ({"updates": 0}, {"not_excited"}),
        ({"dutch_roll": np.full(4, np.nan)}, {"not_converged"}),
        ({"dutch_roll": np.array([2.4, 1.0, 0.2, 0.02])}, {"not_converged"}),
        ({"dutch_roll": np.array([2.4, np.nan, 0.2, 0.02])}, {"not_converged"}),
        ({"whiteness_p": 1e-5}, {"coloured_residuals"}),
        ({"early_response": -0.3}, {"wrong_sign"}),
        ({"simulation_pct": -20.0}, {"not_excited"}),
        ({"simulation_pct": math.nan}, {"not_excited"}),
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
        return ids(agreement_reasons({"els": els, "rml": rml}))

    assert against(2.42, 0.20) == set()
    assert against(2.49, 0.20) == set()  # beyond 3 sigma, within 5 %
    assert against(2.60, 0.20) == {"els_rml_disagree"}
    assert against(2.42, 0.30) == {"els_rml_disagree"}
    assert against(math.nan, math.nan) == set()


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
        pipeline = Pipeline(RunConfig(rate=10.0))
        pipeline.feed(log.data)
        pipeline.finish()
        summary, _ = summarise(pipeline, "log", "")
        return {reason["id"] for reason in summary["verdict"]["reasons"]}

    assert "wrong_sign" not in run(+1)
    assert "wrong_sign" in run(-1)
