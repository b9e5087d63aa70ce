"""The projection: its slopes, its structures, and the noise's AR."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from yawid.manoeuvre.projection import (
    LAGGED,
    ROLL_REAL,
    THREE,
    TWO,
    WITH_ROLL,
    Problem,
    Structure,
    ar_of,
    whitened,
)
from yawid.manoeuvre.responses import Blocks, Record

TS_S = 0.05
AT = {
    TWO: [2.0, 0.15],
    LAGGED: [2.0, 0.15, 6.0],
    THREE: [2.0, 0.15, 1.3],
    WITH_ROLL: [2.0, 0.15, 1.3, 0.5, 4.0],
    ROLL_REAL: [2.0, 0.15, 0.6, 3.0, 5.0],
}
COLOURED = np.array(
    [[[1.0, 0.0], [0.3, 0.8]], [[-0.5, 0.2], [0.1, 0.3]], [[0.1, 0.0], [-0.2, 0.1]]]
)


def noisy(outputs: int, inputs: int = 2) -> Blocks:
    rng = np.random.default_rng(5)
    u = np.repeat(rng.normal(size=(40, inputs)), 10, axis=0)
    y = [rng.normal(size=400) for _ in range(outputs)]
    y[0][150:152] = np.nan
    return Blocks(Record.of(TS_S, u, *y), 3)


@pytest.mark.parametrize("structure", AT, ids=lambda of: f"{of.name}{of.pairs}{of.reals}")
@pytest.mark.parametrize("outputs", [1, 2])
def test_the_slopes_of_the_residual_are_its_differences(structure: Structure, outputs: int):
    problem = Problem(noisy(outputs), structure, COLOURED[:, :outputs, :outputs])
    theta, step = np.log(AT[structure]), 1e-5
    for j, move in enumerate(step * np.eye(len(theta))):
        difference = (problem.at(theta + move).e - problem.at(theta - move).e) / (2.0 * step)
        np.testing.assert_allclose(problem.at(theta).J[:, j], difference, atol=1e-7)


def test_the_ar_makes_noise_of_two_outputs_white_and_of_variance_1():
    rng = np.random.default_rng(8)
    e = rng.normal(size=(2, 3000))
    v = np.stack([lfilter([0.4], [1.0, -1.2, 0.6], e[0]), 2.0 * e[1] + 3.0 * e[0]])
    blocks = Blocks(Record.of(TS_S, np.zeros((3000, 1)), *v), 1)
    D = ar_of(blocks, v)
    white = whitened(blocks, D, v[:, :, None])[:, :, 0]

    assert len(D) == 3
    for lag in range(3):
        correlation = white[:, lag:] @ white[:, : 3000 - lag].T / 3000
        expected = np.eye(2) if lag == 0 else np.zeros((2, 2))
        np.testing.assert_allclose(correlation, expected, atol=0.06)


def test_white_noise_has_no_ar_and_few_rows_have_a_short_one():
    v = np.random.default_rng(2).normal(size=(1, 3000))
    slow = lfilter([1.0], [1.0, -2.4, 1.9, -0.4, -0.1], v)[:, :60]
    for each, most in ((v, 1), (slow, 1 + 60 // 20)):
        blocks = Blocks(Record.of(TS_S, np.zeros((each.size, 1)), each[0]), 1)
        assert len(ar_of(blocks, each)) <= most
