"""The fit against truths: eq. 23 and a linear aircraft with a roll loop, exactly simulated."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from manoeuvre.exact import Floats, doublets, lateral, record, states, yaw_channel

from yawid.manoeuvre.answer import answer_of
from yawid.manoeuvre.fit import Fit, fits_of
from yawid.manoeuvre.responses import Record


def named(fits: list[Fit], name: str) -> Fit:
    return next(fit for fit in fits if fit.structure.name == name)


def pair(fit: Fit) -> Floats:
    return np.asarray(np.exp(fit.log_pair))


@pytest.mark.parametrize("hz", [10, 50])
@pytest.mark.parametrize(
    ("wn", "zeta", "noise"), [(0.5, 0.02, 0.01), (2.0, 0.1, 0.0), (6.0, 0.5, 0.01)]
)
def test_a_mode_is_found_at_every_rate_without_a_start(
    hz: int, wn: float, zeta: float, noise: float
):
    """Without noise to a millionth."""
    u = doublets(wn, 1.0 / hz, periods=7.0)
    y = yaw_channel(u, 1.0 / hz, wn=wn, zeta=zeta)
    found = pair(fits_of(record(u, y, 1.0 / hz, noise=noise))[0])
    assert found == pytest.approx([wn, zeta], rel=max(noise, 1e-6), abs=0.3 * noise)


def test_a_flight_already_in_motion_with_a_gap_is_fitted_as_well():
    u = doublets(2.0, 0.05, periods=9.0)
    y = yaw_channel(u, 0.05)
    y[300:340] = np.nan
    found = fits_of(Record.of(0.05, u[30:, None], y[30:]))
    assert len(found[0].blocks.runs) == 2
    assert pair(found[0]) == pytest.approx([2.0, 0.1], rel=1e-5)


def test_an_aileron_that_yaws_is_a_second_input():
    u = doublets(2.0, 0.05, periods=9.0)
    aileron = 2.0 * np.roll(u, 37)
    y = yaw_channel(u, 0.05) + yaw_channel(aileron, 0.05, K=0.2, T_s=-0.5)
    both = fits_of(Record.of(0.05, np.stack([u, aileron], axis=1), y))[0]
    alone = fits_of(Record.of(0.05, u[:, None], y))[0]

    assert pair(both) == pytest.approx([2.0, 0.1], rel=1e-5)
    assert pair(alone) != pytest.approx([2.0, 0.1], rel=0.01)
    at_rest = both.response(np.array([1e-6]))[0][:, 0]
    assert at_rest == pytest.approx([0.3, 0.2], rel=1e-4)


def test_roll_separates_the_roll_loop_from_the_dutch_roll():
    u = doublets(2.0, 0.05, periods=12.0)
    r, roll, truth = lateral(u, 0.05)
    rng = np.random.default_rng(4)
    y, roll = (x + 1e-3 * np.abs(x).max() * rng.standard_normal(len(x)) for x in (r, roll))
    fits = fits_of(Record.of(0.05, u[:, None], y, roll))

    off = {fit.structure.name: np.abs(np.log(pair(fit) / truth)).max() for fit in fits}
    assert off["roll"] < 0.02
    assert min(off[name] for name in ("2", "2L", "3")) > 2.0 * off["roll"]


def test_real_mode_next_to_the_dutch_roll_is_not_taken_for_its_damping():
    A = [[0.0, 1.0, 0.0], [-4.0, -0.6, 0.0], [0.0, 0.0, -0.7]]
    u = doublets(2.0, 0.05, periods=9.0)
    x = states(A, [[0.0], [1.0], [1.0]], u[:, None], 0.05)
    fits = fits_of(record(u, x @ [0.5, 1.0, 0.4], 0.05, noise=1e-3))

    assert min(fits, key=lambda fit: fit.bic).structure.name == "3"
    assert pair(named(fits, "3")) == pytest.approx([2.0, 0.15], rel=0.01)


def test_sigma_is_the_scatter_of_the_same_manoeuvre_in_other_noise():
    u = doublets(3.0, 0.1, periods=5.0)
    y = yaw_channel(u, 0.1, wn=3.0, zeta=0.2)
    z = []
    for seed in range(30):
        fit = fits_of(record(u, y, 0.1, noise=0.05, seed=seed))[0]
        z.append((fit.log_pair - np.log([3.0, 0.2])) / np.sqrt(np.diag(fit.covariance)[:2]))
    rms = np.sqrt(np.mean(np.square(z), axis=0))
    assert ((rms > 0.6) & (rms < 1.25)).all(), rms


def test_sigma_of_the_response_follows_from_its_slopes():
    u = doublets(2.0, 0.05)
    fit = named(fits_of(record(u, yaw_channel(u, 0.05), 0.05, noise=0.01)), "3")
    w, step = np.array([1.3, 2.4]), 1e-6
    G, slopes = fit.response(w)
    for j in range(len(fit.covariance)):
        theta, elements = fit.theta.copy(), fit.elements.copy()
        (theta if j < len(theta) else elements)[j if j < len(theta) else j - len(theta)] += step
        moved = replace(fit, theta=theta, elements=elements)
        np.testing.assert_allclose((moved.response(w)[0] - G) / step, slopes[j], atol=1e-4)


@pytest.mark.parametrize(
    "of",
    [
        lambda u, noise: (u[:20], noise[:20]),
        lambda u, noise: (u[:20], np.full(20, np.nan)),
        lambda u, noise: (u, 0.0 * noise),
        lambda u, noise: (0.0 * u, noise),
        lambda u, noise: (u, np.arange(len(u)) * 1.0),
        lambda u, noise: (u, np.exp(0.03 * np.arange(len(u)))),
    ],
    ids=["too few", "nothing measured", "still yaw rate", "still rudder", "ramp", "runs away"],
)
def test_a_record_that_shows_no_mode_has_no_answer_and_no_accident(of: Any):
    u, y = of(doublets(2.0, 0.05), np.random.default_rng(1).standard_normal(377))
    assert answer_of(fits_of(Record.of(0.05, u[:, None], y))) is None
