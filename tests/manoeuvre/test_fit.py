"""The fit against truths that are exactly simulated, its likelihood, what it sees of samples."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from manoeuvre.exact import Floats, doublets, fits_with_roll, lateral, record, states, yaw_channel
from manoeuvre.streams import TS_S, stream
from scipy.optimize import minimize_scalar

from yawid.blocks import SampleBlock
from yawid.manoeuvre.answer import answer_of
from yawid.manoeuvre.fit import Fit, best_alone, fits_of
from yawid.manoeuvre.likelihood import free_decay, freed, shifted, simulated, surface
from yawid.manoeuvre.responses import Blocks, Record
from yawid.manoeuvre.signals import fitted, record_of, roll_fault


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


def test_roll_separates_the_roll_loop_from_the_dutch_roll():
    fits, truth = fits_with_roll()
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


def test_the_surface_has_at_each_point_the_squares_of_the_best_other_poles(fit: Fit):
    """A pair alone has none; next to another pair is a spiral mode of 3.3 s, which is searched."""
    u = doublets(2.0, 0.05, periods=8.0)
    A, B = [[0.0, 1.0, 0.0], [-4.0, -0.4, 0.0], [0.0, 0.0, -0.3]], [[0.0], [1.2], [0.3]]
    y = states(A, B, u[:, None], 0.05) @ [1.0, 0.8, 1.0]
    richer = best_alone(fits_of(record(u, y, 0.05, noise=0.05)))
    assert (len(fit.theta), richer.structure.name) == (2, "3")
    for each, points, near in (
        (fit, ((0, 0), (2, 9), (5, 5), (10, 4)), 1e-5),
        (richer, ((3, 5), (5, 7), (7, 4), (1, 8)), 1e-3),
    ):
        found, blocks = surface(each), each.blocks
        assert np.unravel_index(found.nats.argmin(), found.nats.shape) == (5, 5)
        assert (found.wn_rad_s[5], found.zeta[5]) == pytest.approx(np.exp(each.log_pair).tolist())
        own = least_squares(each, blocks, each.theta)
        for i, j in points:
            start = np.concatenate([np.log([found.wn_rad_s[j], found.zeta[i]]), each.theta[2:]])

            def squares(a: float, of: Fit = each, at: np.ndarray = start) -> float:
                return least_squares(of, of.blocks, np.append(at[:2], at[2:] + a))

            best = minimize_scalar(squares, bounds=(-1.0, 1.0), method="bounded").fun
            nats = 0.5 * len(blocks) * np.log(best / own)
            assert found.nats[i, j] == pytest.approx(nats, rel=near, abs=1e-6)


RUDDER = doublets(2.0, TS_S, periods=10.0)
R, ROLL, TRUTH = lateral(RUDDER, TS_S)
NOISE = np.random.default_rng(6).standard_normal((3, len(R)))


def samples(roll: Floats = ROLL, aileron: Floats | float = np.nan) -> SampleBlock:
    return stream(RUDDER, y=R + 1e-3 * NOISE[1], roll=roll, aileron=aileron)


@pytest.mark.parametrize(
    ("roll", "fault"),
    [
        (ROLL + 1e-4 * NOISE[2], ""),
        (np.where(np.arange(len(R)) < 40, ROLL, np.nan), "roll is missing"),
        (0.0 * ROLL, "roll stays where it is"),
        (np.round(ROLL / np.ptp(ROLL)), "roll stays where it is"),
    ],
)
def test_a_roll_that_is_missing_or_stays_where_it_is_is_left_out(roll: Floats, fault: str):
    assert roll_fault(samples(roll)) == fault


@pytest.mark.parametrize(
    "seen",
    [
        lambda roll: np.round(roll / roll.std()) * roll.std(),
        lambda roll: np.repeat(roll[::5], 5)[: len(roll)],
    ],
    ids=["coarse", "slow"],
)
def test_even_a_coarse_or_slow_roll_shows_the_dutch_roll_better_than_none(
    seen: Callable[[Floats], Floats],
):
    off = []
    for roll in (seen(ROLL), np.zeros(len(R))):
        found = answer_of(fitted(samples(roll)).fits, has_roll_loop=True)
        off.append(abs(found.wn_rad_s.value - TRUTH[0]))
        assert off[-1] < 2.0 * found.wn_rad_s.std
        assert abs(found.zeta.value - TRUTH[1]) < 2.0 * found.zeta.std
    assert off[0] < off[1]


def test_a_sample_without_one_of_its_signals_is_a_gap():
    roll = ROLL.copy()
    roll[100] = np.nan
    whole = samples(roll)

    assert record_of(whole, with_roll=False).runs.tolist() == [[0, len(R)]]
    assert record_of(whole).runs.tolist() == [[0, 100], [101, len(R)]]
    assert record_of(whole).y.shape == (len(R), 2)


def test_a_rudder_that_moved_within_its_samples_is_taken_as_held():
    moves = replace(samples(), rudder_moves=np.ones(len(R)))
    plain, corrected = (record_of(x, with_roll=False).u for x in (samples(), moves))
    assert corrected.sum() == pytest.approx(plain.sum(), abs=1e-9)
    assert np.abs(corrected - plain).max() > 0.01
