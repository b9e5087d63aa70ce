from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import cumulative_simpson
from scipy.signal import lti, step

from yawid.errors import NotIdentifiable
from yawid.offline.step_forms import (
    first_order_response,
    first_order_settling,
    overshoot,
    second_order_from_peak,
    second_order_response,
    second_order_settling,
)

T = np.linspace(0.0, 20.0, 2001)
damping, frequency = st.floats(0.02, 0.95), st.floats(0.1, 20.0)
gain = st.floats(0.01, 100.0).flatmap(lambda g: st.sampled_from([g, -g]))


def test_the_closed_forms_are_the_step_responses_of_eq_4_and_7():
    first = lti([1.7], [1.3, 1.0])
    second = lti([1.7 * 4.0], [1.0, 2.0 * 2.0 * 0.3, 4.0])
    np.testing.assert_allclose(first_order_response(T, 1.7, 1.3), step(first, T=T)[1], atol=1e-9)
    np.testing.assert_allclose(
        second_order_response(T, 1.7, 0.3, 2.0), step(second, T=T)[1], atol=1e-9
    )
    before = np.array([-2.0, -1e-9])
    assert not first_order_response(before, 1.7, 1.3).any()
    np.testing.assert_allclose(second_order_response(before, 1.7, 0.3, 2.0), 0.0, atol=1e-15)


def extremum_time(D: float, q: float, i: int = 1) -> float:
    """Return T_i = i pi / (q sqrt(1 - D^2)) of eq. 9, the time of the i-th extremum, in s."""
    return i * math.pi / (q * math.sqrt(1.0 - D * D))


def second_order_weighting(t: np.ndarray, k: float, D: float, q: float) -> np.ndarray:
    """Return g(t) = dh/dt of the model of eq. 7, 0 before t = 0."""
    t, root = np.maximum(t, 0.0), math.sqrt(1.0 - D * D)
    return np.asarray(k * q / root * np.exp(-D * q * t) * np.sin(q * root * t))


def test_the_weighting_function_is_the_slope_of_the_transient_function():
    g = second_order_weighting(T, 1.7, 0.3, 2.0)
    h = second_order_response(T, 1.7, 0.3, 2.0)
    np.testing.assert_allclose(cumulative_simpson(g, x=T, initial=0.0), h, atol=1e-7)


@given(damping, frequency)
def test_eq_9_to_11_give_the_first_extremum_of_the_closed_form(D, q):
    t1 = extremum_time(D, q)
    assert second_order_weighting(np.array([t1]), 1.0, D, q)[0] == pytest.approx(0.0, abs=1e-12 * q)
    h_max = second_order_response(np.array([t1]), 1.0, D, q)[0]
    assert h_max == pytest.approx(1.0 + overshoot(D), abs=1e-12)
    second = second_order_response(np.array([extremum_time(D, q, 2)]), 1.0, D, q)[0]
    assert second == pytest.approx(1.0 - overshoot(D) ** 2, abs=1e-12)


@given(gain, damping, frequency, gain)
def test_eq_12_and_13_turn_the_analytic_extremum_back_into_the_model(k, D, q, u0):
    """To 1e-12, as far as h_max in float64 carries the overshoot at all."""
    y_end = k * u0
    y_max = y_end * (1.0 + overshoot(D))
    found = second_order_from_peak(y_end, y_max, extremum_time(D, q), u0)
    # Delta h is read off h_max, whose last bit weighs 1/overshoot.
    np.testing.assert_allclose(found, (k, D, q), rtol=max(1e-12, 2e-15 / overshoot(D)))


@pytest.mark.parametrize("D", [0.05, 0.2, 0.4, 0.6, 0.8])
def test_eq_12_and_13_are_exact_to_1e_12_at_ordinary_dampings(D):
    y_max = 1.7 * 3.0 * (1.0 + overshoot(D))
    found = second_order_from_peak(1.7 * 3.0, y_max, extremum_time(D, 2.5), 3.0)
    np.testing.assert_allclose(found, (1.7, D, 2.5), rtol=1e-12)


def test_settling_times_are_when_the_response_enters_its_band():
    for tolerance in (0.02, 0.05):
        t = first_order_settling(1.3, tolerance)
        assert first_order_response(np.array([t]), 1.0, 1.3)[0] == pytest.approx(1.0 - tolerance)
        settled = second_order_settling(0.2, 2.0, tolerance) <= T
        misses = np.abs(second_order_response(T, 1.0, 0.2, 2.0) - 1.0)
        assert misses[settled].max() <= tolerance
        assert misses[~settled].max() > tolerance
    assert first_order_settling(1.3, 0.02) == pytest.approx(1.3 * math.log(50.0))


@pytest.mark.parametrize(
    ("y_end", "y_max", "t1"),
    [
        (1.0, 1.0, 1.0),
        (1.0, 0.9, 1.0),
        (1.0, 2.1, 1.0),
        (0.0, 1.0, 1.0),
        (1.0, 1.2, 0.0),
        (1.0, math.nan, 1.0),
    ],
)
def test_what_has_no_overshoot_is_not_eq_7(y_end, y_max, t1):
    with pytest.raises(NotIdentifiable, match=r"eq\. 7"):
        second_order_from_peak(y_end, y_max, t1)
