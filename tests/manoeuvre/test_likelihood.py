"""Likelihood ratios against free decay and against the same rudder at another time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from manoeuvre.exact import doublets, record, states, yaw_channel
from scipy.optimize import minimize_scalar

from yawid.manoeuvre.fit import Fit, best_alone, fits_of
from yawid.manoeuvre.likelihood import free_decay, freed, shifted, simulated, surface
from yawid.manoeuvre.responses import Blocks, Record


def least_squares(fit: Fit, blocks: Blocks, theta: np.ndarray) -> float:
    """Return the squares that poles at theta leave of the yaw rate, by lstsq, whitened alike."""
    poles = fit.structure.poles(theta)
    X = [np.ones((len(blocks), 1)), blocks.y[:, :1]]
    for p, each in zip(poles, blocks.responses(poles), strict=True):
        X = [each.forced.real, each.free.real, *X]
        X = [each.forced.imag, each.free.imag, *X] if p.imag else X
    columns = np.concatenate(X, axis=1)
    white = sum(
        d * np.concatenate([np.zeros((i, columns.shape[1])), columns[: len(columns) - i]])
        for i, d in enumerate(fit.D[:, 0, 0])
    )
    return float(np.linalg.lstsq(white[:, :-1], white[:, -1], rcond=1e-12)[1][0])


@pytest.fixture(scope="module")
def fit() -> Fit:
    u = doublets(2.0, 0.05, periods=8.0)
    return fits_of(record(u, yaw_channel(u, 0.05), 0.05, noise=0.02))[0]


def test_a_rudder_that_moved_the_nose_is_far_likelier_than_free_decay(fit: Fit):
    assert free_decay(fit) > 100.0


def test_a_rudder_that_moved_nothing_is_hardly_likelier_than_free_decay():
    """Of two residues found in noise twice the nats are about chi squared with their number"""
    nats = []
    for seed in range(12):
        u = doublets(2.0, 0.1, periods=6.0)
        y = yaw_channel(np.random.default_rng(seed).normal(size=len(u)), 0.1)
        nats.append(free_decay(fits_of(record(u, y, 0.1, noise=0.1, seed=seed))[0]))
    assert np.median(nats) < 6.0


def test_a_shift_is_judged_as_the_fit_of_a_shifted_record(fit: Fit):
    """The squares of a shifted rudder, by least squares over the same poles, whitened alike

    Free poles follow a small shift.
    """
    nats = shifted(fit, np.array([0, -8, 8, 60, 2]))
    moved = replace(fit.blocks.record, u=np.roll(fit.blocks.record.u, 8, axis=0))
    blocks = Blocks(moved, fit.blocks.q)
    least = least_squares(fit, blocks, fit.theta)
    expected = 0.5 * len(blocks) * np.log(least / np.sum(fit.e[0] ** 2))
    assert nats[2] == pytest.approx(expected, rel=1e-6)
    assert nats[0] == pytest.approx(0.0, abs=1e-4)
    assert (nats[1:4] > 20.0).all()
    assert freed(fit, 2) < nats[4]


def test_the_simulated_yaw_rate_is_the_measured_one_without_its_noise():
    u = doublets(2.0, 0.05, periods=8.0)
    y = yaw_channel(u, 0.05)
    measured, found = simulated(fits_of(Record.of(0.05, u[:, None], y))[0])
    np.testing.assert_allclose(found, measured, atol=1e-6 * np.abs(y).max())


def test_an_aileron_stays_where_it_is_while_the_rudder_is_moved_or_taken_away():
    """All of the yaw is the aileron's, so that no rudder is better than any other, or than none"""
    u = doublets(2.0, 0.05, periods=8.0)
    aileron = 2.0 * np.roll(u, 37)
    fit = fits_of(record(np.column_stack([u, aileron]), yaw_channel(aileron, 0.05), 0.05,
                         noise=0.02))[0]  # fmt: skip
    assert abs(free_decay(fit)) < 6.0
    assert np.abs(shifted(fit, np.array([-8, 8, 60]))).max() < 6.0
    assert abs(freed(fit, 8)) < 6.0


def test_the_surface_of_a_pair_alone_is_the_squares_at_each_of_its_points(fit: Fit):
    found = surface(fit)
    middle = len(found.zeta) // 2
    assert np.unravel_index(found.nats.argmin(), found.nats.shape) == (middle, middle)
    at_fit = found.wn_rad_s[middle], found.zeta[middle]
    assert at_fit == pytest.approx(np.exp(fit.log_pair).tolist(), rel=1e-12)
    own = least_squares(fit, fit.blocks, fit.theta)
    for i, j in ((0, 0), (2, 9), (middle, middle), (10, 4)):
        theta = np.log([found.wn_rad_s[j], found.zeta[i]])
        nats = 0.5 * len(fit.blocks) * np.log(least_squares(fit, fit.blocks, theta) / own)
        assert found.nats[i, j] == pytest.approx(nats, rel=1e-5, abs=1e-6)


def test_the_surface_of_a_richer_structure_has_its_other_pole_where_it_is_best():
    """Next to the pair is a spiral mode of 3.3 s; a scalar search finds where it is best"""
    u = doublets(2.0, 0.05, periods=8.0)
    A, B = [[0.0, 1.0, 0.0], [-4.0, -0.4, 0.0], [0.0, 0.0, -0.3]], [[0.0], [1.2], [0.3]]
    fit = best_alone(fits_of(record(u, states(A, B, u[:, None], 0.05) @ [1.0, 0.8, 1.0], 0.05,
                                    noise=0.05)))  # fmt: skip
    assert fit.structure.name == "3"
    found, own = surface(fit), least_squares(fit, fit.blocks, fit.theta)
    for i, j in ((3, 5), (5, 7), (7, 4), (1, 8)):
        pair = np.log([found.wn_rad_s[j], found.zeta[i]])
        best = minimize_scalar(
            lambda a, pair=pair: least_squares(fit, fit.blocks, np.append(pair, a)),
            bounds=(fit.theta[2] - 1.0, fit.theta[2] + 1.0), method="bounded",
        ).fun  # fmt: skip
        nats = 0.5 * len(fit.blocks) * np.log(best / own)
        assert found.nats[i, j] == pytest.approx(nats, rel=0.01)
