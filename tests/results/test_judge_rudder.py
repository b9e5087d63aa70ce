"""What is said where the rudder explains little, by each of the three tests."""

from __future__ import annotations

import math

import pytest

from yawid.estimation.free_run import RudderEffect
from yawid.results.judge_rudder import rudder_reasons, rudder_shifts


@pytest.mark.parametrize(("effect", "says"), [
    (RudderEffect(0.002, 90.0, 10.0), "no significant effect"),
    (RudderEffect(0.0, 69.0, 60.0), "its free decay alone reaches 60 %"),
    (RudderEffect(0.0, 90.0, 10.0, -0.4, 1.1, 5.0), "moves 0.4 s earlier"),
    (RudderEffect(0.0, 90.0, 10.0, 0.4, 1.1, 5.0), "moves 0.4 s later"),
])  # fmt: skip
def test_each_test_refuses(effect: RudderEffect, says: str):
    (reason,) = rudder_reasons(effect)

    assert reason.id == "mode_not_driven"
    assert reason.exit_code == 5
    assert says in reason.text


@pytest.mark.parametrize("effect", [
    RudderEffect(math.nan, math.nan, math.nan),
    RudderEffect(0.0, 90.0, 80.0),
    RudderEffect(0.001, 90.0, 10.0, 0.4, 1.4, 5.0),
    RudderEffect(0.001, 90.0, 10.0, 0.4, 1.1, 2.9),
])  # fmt: skip
def test_what_passes_or_is_unknown_is_not_refused(effect: RudderEffect):
    assert not list(rudder_reasons(effect))


def test_chance_may_pass_one_of_several_tries_as_often_as_a_single_one():
    effect = RudderEffect(0.0006, 90.0, 10.0)

    assert not list(rudder_reasons(effect))
    (reason,) = rudder_reasons(effect, tries=2)
    assert "0.06 %, and 0.05 % is allowed" in reason.text


def test_shifts_are_parts_of_the_period_and_beyond_b():
    assert rudder_shifts(2.0 * math.pi, 0.05, 3) == (4, 30)  # 1 s: an eighth is 2.5 samples
    assert rudder_shifts(0.2 * math.pi, 0.05, 3) == (25, 300)
    assert rudder_shifts(math.nan, 0.05, 3) is None
