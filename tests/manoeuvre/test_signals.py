"""What of the samples a fit sees, and why roll is left out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from manoeuvre.exact import doublets, lateral, yaw_channel
from manoeuvre.streams import TS_S, stream

from yawid.blocks import Floats, SampleBlock
from yawid.manoeuvre.answer import answer_of
from yawid.manoeuvre.signals import aileron_moves, fitted, record_of, roll_fault

RUDDER = doublets(2.0, TS_S, periods=10.0)
R, ROLL, TRUTH = lateral(RUDDER, TS_S)
NOISE = np.random.default_rng(6).standard_normal((3, len(R)))
P = np.gradient(ROLL, TS_S) + 1e-3 * NOISE[0]
"""The roll rate of level flight."""


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


def test_an_aileron_that_a_hand_moves_is_an_input_and_one_that_holds_the_wings_level_is_none():
    own, held = 0.2 * (np.arange(len(R)) // 23 % 3 == 0), -5.0 * ROLL - 1.5 * P
    assert np.ptp(held) > 0.1
    for aileron, moves in (
        (own - 0.5 * ROLL, True),
        (0.1 * own, False),
        (held, False),
        (np.nan, False),
    ):
        assert aileron_moves(samples(aileron=aileron)) == moves


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


def test_an_aileron_is_an_input_where_it_moves_by_itself_and_explains_the_yaw_rate():
    aileron = 0.2 * (np.arange(len(R)) // 23 % 3 == 0)
    yaws = yaw_channel(RUDDER, TS_S) + yaw_channel(aileron, TS_S, K=0.1) + 1e-4 * NOISE[1]
    still = yaw_channel(RUDDER, TS_S) + 1e-4 * NOISE[1]
    roll = 1e-3 * NOISE[2]
    with_both, alone = (
        fitted(stream(RUDDER, y=y, roll=roll, aileron=aileron)) for y in (yaws, still)
    )
    assert with_both.inputs == ("rudder", "aileron")
    assert len(with_both.fits[0].blocks.u) == 2
    assert np.exp(with_both.fits[0].log_pair) == pytest.approx([2.0, 0.1], rel=0.01)
    assert alone.inputs == ("rudder",)
    assert np.exp(alone.fits[0].log_pair) == pytest.approx([2.0, 0.1], rel=0.01)


def test_without_roll_the_fits_say_why():
    found = fitted(samples(np.zeros(len(R))))
    assert {fit.structure.name for fit in found.fits} == {"2", "2L", "3"}
    assert found.roll_left_out == "roll stays where it is"
