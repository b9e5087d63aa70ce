"""The mean of several manoeuvres: random effects, and what all of them have in common."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from yawid.blocks import Floats
from yawid.manoeuvre.flight import TAU_WN_SHARE, Pooled, pooled


def by_noise(x: Floats, std: Floats, floor: float) -> Pooled:
    """The pooled mean where the structure leaves nothing out"""
    return pooled(x, std, floor, np.zeros_like(x))


# Thirteen trials of a vaccine (Colditz and others, 1994): log risk ratios and their variances, the
# example every text on random effects works out; the results below are those of DerSimonian and
# Laird's method as R's metafor prints them.
EFFECTS = np.array(
    [
        -0.8893, -1.5854, -1.3481, -1.4416, -0.2175, -0.7861, -1.6209,
        0.0120, -0.4694, -1.3713, -0.3394, 0.4459, -0.0173,
    ]
)  # fmt: skip
VARIANCES = np.array(
    [
        0.3256, 0.1946, 0.4154, 0.0200, 0.0512, 0.0069, 0.2230,
        0.0040, 0.0564, 0.0730, 0.0124, 0.5325, 0.0714,
    ]
)  # fmt: skip


def test_the_pooled_numbers_are_those_of_a_published_example():
    found = by_noise(EFFECTS, np.sqrt(VARIANCES), floor=0.0)

    std = math.sqrt(0.3088 + 0.1787**2)
    numbers = (found.tau**2, found.mean, found.error, found.std)
    assert numbers == pytest.approx((0.3088, -0.7141, 0.1787, std), abs=2e-3)


@pytest.mark.parametrize("count", [2, 3, 4, 8, 20])
def test_sigma_covers_what_the_next_manoeuvre_will_say(count: int):
    """Of eight 2 sigma hold 90 % and not 95: tau is an estimate itself"""
    rng, missed = np.random.default_rng(1), []
    for _ in range(1500):
        std = rng.uniform(0.05, 0.2, count)
        x = rng.normal(10.0, 0.2, count) + std * rng.normal(size=count)
        found = by_noise(x, std, floor=TAU_WN_SHARE * 10.0)
        missed.append(abs(rng.normal(10.0, 0.2) - found.mean) / found.std)
    assert 0.58 < np.mean(np.array(missed) < 1.0) < 0.75
    assert 0.84 < np.mean(np.array(missed) < 2.0) < 0.97


def test_a_manoeuvre_without_noise_does_not_hide_how_far_the_others_scatter():
    """What scatters no more than its sigmas has no scatter between."""
    alike = by_noise(np.array([1.0, 1.01, 0.99, 1.0]), np.full(4, 0.1), floor=0.0)
    found = by_noise(np.array([10.0, 10.5, 9.5]), np.array([0.0, 0.1, 0.1]), floor=0.0)

    assert (alike.tau, alike.error) == (0.0, pytest.approx(0.05))
    assert math.isfinite(found.mean)
    assert found.tau > 0.3


@given(
    rows=st.lists(
        st.tuples(st.floats(5.0, 15.0), st.floats(0.01, 1.0), st.floats(0.0, 1.0)),
        min_size=1,
        max_size=8,
    ),
    floor=st.floats(0.0, 0.5),
)
def test_what_noise_does_not_explain_is_in_common_and_weighs_nothing(rows, floor: float):
    """Its root mean square comes on top of the two others; mean, error and tau are without it"""
    x, std, beyond = np.array(rows).T
    found, without = pooled(x, std, floor, beyond), by_noise(x, std, floor)

    assert (found.mean, found.error, found.tau) == (without.mean, without.error, without.tau)
    common = math.sqrt(np.mean(beyond**2))
    assert found.std == pytest.approx(math.sqrt(found.error**2 + found.tau**2 + common**2))
    assert found.noise == pytest.approx(1.0 / math.sqrt(np.sum(std**-2.0)))
    assert found.noise <= found.error * (1.0 + 1e-12)
