"""What the samples say for or against an answer: each reason speaks in one case, not in another."""

from __future__ import annotations

import math

import numpy as np
import pytest
from flightlog import summarised
from hypothesis import given
from hypothesis import strategies as st
from places import REPLAY_LOGS

from yawid.config.run import RunConfig
from yawid.estimation.bank import SampleHistory
from yawid.results.judge_samples import (
    changed_rates,
    closeness,
    damper_reasons,
    feedback_reasons,
    flight_reasons,
    input_reasons,
    rate_reasons,
)
from yawid.results.reasons import Reason


def ids(reasons) -> set[str]:
    return {reason.id for reason in reasons}


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


def history(**changes) -> SampleHistory:
    rng = np.random.default_rng(2)
    n = 1000
    columns = {
        "u": rng.standard_normal((n, 1)),
        "y": rng.standard_normal(n),
        "roll": rng.standard_normal(n),
        "turn_rate": rng.standard_normal(n),
        "airspeed": np.full(n, 20.0),
        "aileron": np.full(n, np.nan),
        "mode": np.full(n, np.nan),
        "y_hat": {},
    }
    return SampleHistory(**(columns | changes))


def test_flying_that_hides_the_rudder_is_said():
    base = history()

    assert ids(flight_reasons(base, "keep")) == set()
    turns = history(turn_rate=base.y + 0.5 * base.turn_rate)
    assert ids(flight_reasons(turns, "keep")) == {"turn_dominated"}
    assert ids(flight_reasons(turns, "remove")) == set()
    assert ids(flight_reasons(history(turn_rate=-turns.turn_rate), "keep")) == set()
    faster = history(airspeed=np.linspace(15.0, 25.0, 1000))
    assert ids(flight_reasons(faster, "keep")) == {"airspeed_changed"}
    assert ids(flight_reasons(history(turn_rate=np.full(1000, np.nan)), "keep")) == set()


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
    base = history()
    damper = history(u=-base.y[:, None], y=base.y)

    (found,) = damper_reasons(damper, 0.85, -0.2)
    assert found.id == "mode_not_driven"
    assert "opposes the yaw as a yaw damper does" in found.text
    assert ids(damper_reasons(damper, 0.85, 0.2)) == set()  # it reacts and turns the nose
    assert ids(damper_reasons(damper, 0.6, -0.2)) == set()  # a reversed servo that somebody moves


def test_what_goes_with_the_yaw_is_no_damper():
    """A correlation of +0.8, as of a rudder that coordinates turns"""
    base = history()
    noise = 0.75 * np.random.default_rng(9).standard_normal(1000)
    with_it = history(u=(base.y + noise)[:, None], y=base.y)

    (found,) = damper_reasons(with_it, 0.85, -0.2)
    assert found.id == "mode_not_driven"
    assert "correlation +0.79" in found.text
    assert "damper" not in found.text


def test_a_roll_hold_taken_for_an_input_is_told_apart_from_an_excited_aileron():
    def closed_loop(case):
        inputs = ("rudder", "aileron")
        config = RunConfig(rate=10.0, forgetting=1.0, inputs=inputs, manoeuvres="off")
        reasons = summarised(REPLAY_LOGS / case / "log.tlog", config)[1].reasons
        return [reason.text for reason in reasons if reason.id == "closed_loop"]

    [text] = closed_loop("c172p_3211")
    assert text.startswith("yaw rate and roll explain 99 % of the aileron")
    assert closed_loop("c172p_aileron") == []
