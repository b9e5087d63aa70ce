"""Likelihood ratios against free decay and against the same rudder at another time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from manoeuvre.exact import doublets, record, yaw_channel

from yawid.manoeuvre.fit import Fit, fits_of
from yawid.manoeuvre.likelihood import free_decay, freed, shifted, simulated
from yawid.physics.responses import Blocks, Record


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


def test_without_a_shift_nothing_is_lost_and_with_one_much(fit: Fit):
    nats = shifted(fit, np.array([0, -8, 8, 60]))
    assert nats[0] == pytest.approx(0.0, abs=1e-4)
    assert (nats[1:] > 20.0).all()


def test_a_shift_is_judged_as_the_fit_of_a_shifted_record(fit: Fit):
    """The squares of a shifted rudder, by least squares over the same poles, whitened alike"""
    record = fit.blocks.record
    moved = replace(record, u=np.roll(record.u, 8, axis=0))
    blocks = Blocks(moved, fit.blocks.q)
    response = blocks.responses(fit.structure.poles(fit.theta))[0]
    X = np.concatenate(
        [response.forced.real, response.forced.imag, response.free.real, response.free.imag], axis=1
    )
    columns = np.column_stack([X, np.ones(len(X)), blocks.y[:, 0]])
    white = sum(
        d * np.concatenate([np.zeros((i, columns.shape[1])), columns[: len(columns) - i]])
        for i, d in enumerate(fit.D[:, 0, 0])
    )
    least = np.linalg.lstsq(white[:, :-1], white[:, -1], rcond=1e-12)[1][0]
    nats = 0.5 * len(X) * np.log(least / np.sum(fit.e[0] ** 2))
    assert shifted(fit, np.array([8]))[0] == pytest.approx(nats, rel=1e-6)


def test_free_poles_follow_a_small_shift(fit: Fit):
    assert freed(fit, 2) < shifted(fit, np.array([2]))[0]


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
