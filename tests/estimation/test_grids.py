"""Steps within samples by hand."""

from __future__ import annotations

import numpy as np
import pytest

from yawid.estimation.grids import as_held


def moment(u: np.ndarray, power: int) -> float:
    """The moment of the steps of u (n, 1) about 0, with steps of the whole grid at 0, 1, 2, ..."""
    return float(np.sum(np.diff(u[:, 0]) * np.arange(1, len(u)) ** power))


def test_over_all_places_in_a_sample_a_step_keeps_its_second_moment():
    shares = np.linspace(0.0, 1.0, 201)[1:-1]
    spread = {"mean": 0.0, "held": 0.0}
    for a in shares:
        mean = np.array([0.0, 0.0, 0.0, 1.0 - a, 1.0, 1.0, 1.0])[:, None]
        held = as_held(mean, np.arange(7) == 3)
        assert [moment(held, power) for power in (0, 1)] == pytest.approx([1.0, 3.0 + a])
        for name, u in (("mean", mean), ("held", held)):
            spread[name] += (moment(u, 2) - (3.0 + a) ** 2) / len(shares)

    assert spread["mean"] == pytest.approx(1.0 / 6.0, rel=0.01)
    assert abs(spread["held"]) < 0.002


def test_a_ramp_loses_nothing_and_a_parabola_what_its_means_add():
    t = np.arange(20.0)
    ramp, parabola = t + 0.5, t**2 + t + 1.0 / 3.0  # the means of t and of t squared

    inner, everywhere = slice(2, -2), np.ones(20, bool)
    np.testing.assert_allclose(as_held(ramp[:, None], everywhere)[inner, 0], ramp[inner])
    # Held, v acts as its own mean once more: its second difference / 12 is taken off, 2 / 12.
    np.testing.assert_allclose(
        as_held(parabola[:, None], everywhere)[inner, 0], parabola[inner] - 1.0 / 6.0
    )


def test_what_moves_at_the_instants_or_next_to_a_missing_sample_stays():
    u = np.random.default_rng(2).standard_normal((30, 2))
    u[10] = np.nan

    np.testing.assert_array_equal(as_held(u, np.zeros(30, bool)), u)
    rests = np.where(np.isnan(u), np.nan, 1.0)
    np.testing.assert_array_equal(as_held(rests, np.ones(30, bool)), rests)
