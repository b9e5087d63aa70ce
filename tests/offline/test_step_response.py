"""``yawid step``'s fits: against exact closed forms, scipy's own step responses, and noise."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import lfilter, lti, step

from yawid.errors import ConfigError, NotIdentifiable
from yawid.offline.step_response import (
    FORMS,
    first_order_response,
    fit_step,
    second_order_from_curve,
    settling,
    yaw_response,
)
from yawid.plant.excitation import Excitation
from yawid.plant.simulate import REFERENCE, simulate_plant
from yawid.plant.yaw import YawPlant

RUNS = 200
second_order_response = FORMS["second"].response
T = np.linspace(-2.0, 20.0, 440)
UNEVEN = np.random.default_rng(14).uniform(0.0, 0.4, 500)


def test_the_closed_forms_are_the_step_responses_of_eq_4_7_and_23():
    t = np.linspace(0.0, 20.0, 2001)
    for found, transfer in (
        (first_order_response(t, 1.7, 1.3), lti([1.7], [1.3, 1.0])),
        (second_order_response(t, 1.7, 0.3, 2.0), lti([6.8], [1.0, 1.2, 4.0])),
        (yaw_response(t, 1.7, 0.6, 0.3, 2.0), lti([4.08, 6.8], [1.0, 1.2, 4.0])),
    ):
        np.testing.assert_allclose(found, step(transfer, T=t)[1], atol=1e-9)
    before = np.array([-2.0, -1e-9])
    assert not first_order_response(before, 1.7, 1.3).any()
    assert not second_order_response(before, 1.7, 0.3, 2.0).any()


@given(st.floats(0.02, 0.9), st.floats(0.1, 20.0))
def test_eq_9_to_13_turn_the_extremum_of_the_closed_form_back_into_d_and_q(D, q):
    """The first extremum is at T1 = pi / (q sqrt(1 - D^2)), and the second is smaller by D."""
    t1 = math.pi / (q * math.sqrt(1.0 - D * D))
    t = np.array([0.0, t1, 2.0 * t1])
    h = second_order_response(t, 1.0, D, q)
    overshoot = math.exp(-math.pi * D / math.sqrt(1.0 - D * D))  # eq. 10-11
    np.testing.assert_allclose(h, [0.0, 1.0 + overshoot, 1.0 - overshoot**2], atol=1e-12)
    # Delta h is read off h_max, whose last bit weighs 1/overshoot.
    rtol = max(1e-12, 2e-15 / overshoot)
    np.testing.assert_allclose(second_order_from_curve(t, h), (D, q), rtol=rtol)


def test_settling_times_are_when_the_response_enters_its_band():
    for tolerance in (0.02, 0.05):
        assert settling(FORMS["first"], tolerance, 1.3) == pytest.approx(-1.3 * math.log(tolerance))
        settled = settling(FORMS["second"], tolerance, 0.2, 2.0) <= T
        misses = np.abs(second_order_response(T, 1.0, 0.2, 2.0) - 1.0)
        assert misses[settled].max() <= tolerance
        assert misses[~settled].max() > tolerance


gain = st.floats(0.01, 100.0).flatmap(lambda g: st.sampled_from([g, -g]))


@given(
    gain, st.floats(0.05, 4.0), st.floats(0.03, 0.9), st.floats(0.5, 3.0), gain,
    st.floats(-50.0, 50.0), st.floats(-5.0, 5.0),
)  # fmt: skip
def test_exact_samples_give_the_parameters_back_to_1e_6(K, tau, D, q, u0, offset, start):
    """Of both forms, with their settling times, although times are uneven and samples missing."""
    # An offset far above the step costs digits before any fit.
    rel = 1e-6 if abs(offset) < 1e4 * abs(K * u0) else 1e-3
    length_s = 1.2 * settling(FORMS["second"], 0.02, D, q)
    for form, t, parameters in (
        ("first", T, {"K": K, "T": tau}),
        ("second", np.linspace(0.0, length_s, 500), {"k": K, "D": D, "q": q}),
    ):
        shape = [*parameters.values()][1:]
        t = t + (t[1] - t[0]) * UNEVEN[: len(t)]
        y = offset + u0 * FORMS[form].response(t, *parameters.values())
        y[::11] = np.nan
        found = fit_step(form, t + start, y, u0, start)
        values = {name: each.value for name, each in found.parameters.items()}
        assert values == pytest.approx(parameters, rel=rel)
        for share, each in ((0.02, found.settling_2pct_s), (0.05, found.settling_5pct_s)):
            assert each.value == pytest.approx(settling(FORMS[form], share, *shape), rel=rel)


def test_the_papers_formulas_are_right_to_the_sample_and_stand_next_to_the_fit():
    """K and T where the response passes 63 %; k, D and q from the overshoot and its time."""
    first = fit_step("first", T, 3.0 + 2.0 * first_order_response(T, 0.8, 1.3), 2.0)
    second = fit_step("second", T, second_order_response(T, -1.0, 0.3, 2.0))
    assert first.formula == pytest.approx({"K": 0.8, "T": 1.3}, rel=0.002)
    assert second.formula == pytest.approx({"k": -1.0, "D": 0.3, "q": 2.0}, rel=0.02)


@pytest.mark.parametrize(
    ("form", "truths", "pole"),
    [
        ("first", (0.8, 0.5), 0.0),
        pytest.param("first", (0.8, 2.0), 0.0, marks=pytest.mark.long),
        ("second", (1.0, 0.2, 2.5), 0.0),
        pytest.param("second", (1.0, 0.5, 1.5), 0.0, marks=pytest.mark.long),
        ("first", (1.0, 1.0), 0.8),
    ],
)
def test_with_2_percent_noise_the_95_percent_intervals_cover(form, truths, pole):
    """Also of first-order noise, where sigma for white noise would cover about half."""
    rng, hits, u0 = np.random.default_rng(11), [], -1.5
    for _ in range(RUNS):
        white = 0.02 * abs(truths[0] * u0) * rng.standard_normal(2 * len(T))
        noise = lfilter([np.sqrt(1.0 - pole**2)], [1.0, -pole], white)[len(T) :]
        found = fit_step(form, T, 5.0 + u0 * FORMS[form].response(T, *truths) + noise, u0)
        values = [*found.parameters.values(), found.settling_2pct_s, found.settling_5pct_s]
        settled = [settling(FORMS[form], share, *truths[1:]) for share in (0.02, 0.05)]
        pairs = zip(values, [*truths, *settled], strict=True)
        hits.append([abs(value.value - true) <= 1.959964 * value.std for value, true in pairs])
    coverage = np.mean(hits, axis=0)
    assert (coverage >= (0.88 if pole else 0.90)).all(), coverage
    assert (coverage <= 0.98 + 0.02 * (pole > 0.0)).all(), coverage


@given(
    st.integers(0, 2**32 - 1), st.integers(10, 150), st.integers(0, 2), st.floats(-9.0, 9.0),
    st.sampled_from(list(FORMS)),
)  # fmt: skip
def test_any_record_is_fitted_or_refused_never_half_done(seed, n, sums, decade, model):
    """White noise, a random walk or its integral, of any size: finite values or one clear error."""
    rng = np.random.default_rng(seed)
    y = 10.0**decade * rng.standard_normal(n)
    for _ in range(sums):
        y = np.cumsum(y)
    try:
        found = fit_step(model, np.arange(n) * 0.1, y)
    except NotIdentifiable:
        return
    values = [*found.parameters.values(), found.settling_2pct_s, found.settling_5pct_s]
    assert all(math.isfinite(v.value) and math.isfinite(v.std) for v in values)


@pytest.mark.parametrize("noise", [0.0, 0.0005])
def test_eq_23_s_own_form_gives_the_plant_back(noise):
    excitation = Excitation(kind="step", amplitude=0.05, start_s=5.0)
    flown = simulate_plant("yaw", excitation, duration_s=40.0, noise_std=noise, seed=3)
    true = YawPlant.from_coefficients(REFERENCE)

    found = fit_step("yaw", flown.t, flown.y, 0.05, 5.0)

    for name in ("K", "T_theta_s", "omega_beta", "xi_beta"):
        value, sigma = found.parameters[name].value, found.parameters[name].std
        assert abs(value - getattr(true, name)) < 3.0 * sigma + 1e-6, name
        assert sigma < 0.05 * value, name
    band = 0.05 * abs(found.parameters["K"].value) * 0.05
    late = flown.t > 5.0 + found.settling_5pct_s.value
    assert np.abs(flown.y[late] - true.K * 0.05).max() < band + 5.0 * noise
    assert np.abs(flown.y[~late][-60:] - true.K * 0.05).max() > 0.5 * band


FLOWN = simulate_plant("yaw", Excitation(kind="step"), duration_s=20.0)
SHORT = slice(0, 100)
WHITE = np.random.default_rng(17).standard_normal(len(T))
LAG, RUN_UP = first_order_response(T, 1.0, 2.0), np.maximum(T, 0.0)
SLOW = second_order_response(T, 1.0, 0.05, 2.0)


@pytest.mark.parametrize(
    ("model", "t", "y", "text"),
    [
        ("second", T, LAG, "eq. 7"),
        *(
            ("first", T, second_order_response(T, 1.0, D, 2.0), "this form")
            for D in (0.1, 0.3, 0.6)
        ),
        # Its zero and its lasting oscillation: K and D read off it would be wrong without a word.
        ("first", FLOWN.t, FLOWN.y, "this form"),
        ("second", FLOWN.t, FLOWN.y, "eq. 7"),
        ("first", T[SHORT], LAG[SHORT], "steady"),
        ("second", T[:200], SLOW[:200], "steady"),
        ("first", T, RUN_UP, "steady"),
        *((model, T, y, "does not respond") for model in FORMS for y in (WHITE, np.ones(len(T)))),
    ],
)
@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_a_form_that_does_not_hold_and_a_record_without_an_answer_are_refused(
    model, t, y, text, noise
):
    noisy = y + noise * np.random.default_rng(15).standard_normal(len(y))
    with pytest.raises(NotIdentifiable, match=text):
        fit_step(model, t, noisy)


def test_samples_too_coarse_for_the_transient_are_refused():
    with pytest.raises(NotIdentifiable, match=r"too few|too little"):
        fit_step("first", T, first_order_response(T, 1.0, 1e-4))


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"t": T[::-1]}, "increasing"),
        ({"t": np.where(T > 3.0, np.nan, T)}, "finite"),
        ({"y": np.where(T > 3.0, np.inf, T)}, "finite"),
        ({"u0": 0.0}, "u0"),
        ({"step_time_s": 19.9}, "samples after the step"),
        ({"step_time_s": math.nan}, "u0 must be finite|step at"),
    ],
)
def test_a_record_that_is_none_is_refused(change, text):
    record = {"t": T, "y": first_order_response(T, 1.0, 1.0)} | change
    for model in FORMS:
        with pytest.raises(ConfigError, match=text):
            fit_step(model, **record)
