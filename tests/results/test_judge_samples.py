"""What the samples say for or against an answer: each reason speaks in one case, not in another."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from yawid.results.judge_samples import changed_rates, closeness, message_rate_reasons


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
