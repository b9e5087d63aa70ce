"""Steps within samples by hand."""

from __future__ import annotations

import numpy as np

from yawid.estimation.grids import as_held


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
