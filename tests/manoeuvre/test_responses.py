"""The exact responses of poles over blocks, the slopes of the projection on them, and its AR."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from manoeuvre.exact import Floats, doublets, states
from manoeuvre.streams import stream
from scipy.signal import lfilter

from yawid.manoeuvre.answer import answer_of
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
from yawid.manoeuvre.responses import (
    LEAST_BLOCKS,
    Blocks,
    Record,
    averaged,
    block_size,
    inputs_and_rate,
)
from yawid.manoeuvre.signals import fitted

TS_S = 0.05
POLES = np.array([-0.3 + 2.0j, -1.5 + 0.0j])


def moved(n: int = 200) -> Floats:
    return np.repeat(np.random.default_rng(3).normal(size=(n // 10, 2)), 10, axis=0)


@pytest.mark.parametrize("q", [1, 3])
def test_a_response_is_that_of_the_differential_equation_averaged_over_blocks(q: int):
    u = moved()
    record = Record.of(TS_S, u, np.zeros(len(u)))
    found = Blocks(record, q).responses(POLES)
    for pole, response in zip(POLES, found, strict=True):
        A = [[pole.real, -pole.imag], [pole.imag, pole.real]]
        for i in range(2):
            x = states(A, [[1.0], [0.0]], record.u[:, i : i + 1], TS_S)
            exact = x @ [1.0, 1.0j]
            rows = len(response.forced) * q
            mean = exact[:rows].reshape(-1, q).mean(axis=1)
            np.testing.assert_allclose(response.forced[:, i], mean, atol=1e-12)


def test_a_gap_ends_a_run_whose_free_response_is_its_own():
    y = np.zeros(200)
    y[100] = np.nan
    blocks = Blocks(Record.of(TS_S, moved(), y), 4)
    response = blocks.responses(POLES[:1])[0]

    assert blocks.runs.tolist() == [[0, 25], [25, 49]]
    decay = np.exp(POLES[0] * TS_S * np.arange(100)).reshape(-1, 4).mean(axis=1)
    np.testing.assert_allclose(response.free[:25, 0], decay, atol=1e-12)
    np.testing.assert_allclose(response.free[25:, 1], decay[:24], atol=1e-12)
    assert not response.free[25:, 0].any()
    assert response.forced[25].tolist() != response.forced[24].tolist()


def test_a_run_too_short_for_its_own_initial_state_is_left_out():
    y = np.zeros(200)
    y[4 * LEAST_BLOCKS - 1] = np.nan
    assert Blocks(Record.of(TS_S, moved(), y), 4).runs.tolist() == [[0, (200 - 32) // 4]]


def test_blocks_are_a_share_of_the_period_whatever_the_rate():
    for hz in (10, 20, 50):
        record = Record.of(1.0 / hz, np.zeros((100 * hz, 1)), np.zeros(100 * hz))
        sixteenth = 2.0 * np.pi / 16
        assert 0.75 * sixteenth < block_size(record, 1.0, 16, 80) / hz <= sixteenth
    short = Record.of(0.05, np.zeros((100, 1)), np.zeros(100))
    assert block_size(short, 0.5, 16, 80) == 1


def test_a_row_without_one_of_its_signals_is_a_gap_in_all() -> None:
    """The turn is taken off where asked; a measured rudder moves within each sample of a step."""
    lacks = np.arange(60) // 10
    samples = stream(
        np.where(lacks == 0, np.nan, 0.2 * (lacks == 5)), y=np.ones(60),
        aileron=np.where(lacks == 1, np.nan, 0.2), turn=np.where(lacks == 2, np.nan, 0.3),
    )  # fmt: skip
    roll = np.where(lacks == 3, np.nan, 0.0)
    for turn, measured, moved in ((True, False, 0), (False, True, 2)):
        u, held, y = inputs_and_rate(
            samples, ["rudder", "aileron"], roll, measured=measured, turn_removed=turn
        )
        known = lacks > 3 if turn else (lacks > 3) | (lacks == 2)
        for each in (u[:, 0], u[:, 1], held[:, 0], held[:, 1], y):
            np.testing.assert_array_equal(np.isfinite(each), known)
        np.testing.assert_allclose(y[known], 0.7 if turn else 1.0)
        assert np.count_nonzero(u[known, 0] != held[known, 0]) == moved


@pytest.mark.parametrize("step_s", [0.025, 0.05, 0.1])
def test_a_mean_yaw_rate_has_the_poles_and_the_gain_of_the_yaw_rate_itself(step_s: float) -> None:
    """The steps of an exact heading: its yaw rate has a pair of 2 rad/s, and roll its residues"""
    rudder = doublets(2.0, step_s, periods=8.0)
    A = [[0.0, 1.0, 0.0], [-4.0, -0.4, 0.0], [1.2, 0.96, 0.0]]
    x = states(A, [[0.0], [1.0], [0.0]], rudder[:, None], step_s)
    y = np.append(0.0, np.diff(x[:, 2]) / step_s)
    flown = replace(stream(rudder, y=y, roll=x[:, 0]), sample_time_s=step_s)
    seen = fitted(averaged(flown, measured=False))
    found = answer_of(seen.fits)
    assert seen.roll_left_out == ""
    assert found.wn_rad_s.value == pytest.approx(2.0, rel=1e-3)
    assert found.zeta.value == pytest.approx(0.1, abs=1e-3)
    assert found.eq_23.yaw_acceleration.value == pytest.approx(0.96, rel=2e-3)


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
