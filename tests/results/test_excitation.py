"""Only what the rudder does by itself teaches how the yaw answers it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from yawid.results.excitation import LEAST_STROKE, excitation, own_part
from yawid.results.judge_samples import excitation_reasons

TS = 0.05
UNKNOWN = np.full(2000, np.nan)


def moving(seed: int, size: float, n: int = 2000) -> np.ndarray:
    """A surface that somebody moves: smooth over some tenths of a second."""
    rng = np.random.default_rng(seed)
    steps = np.repeat(rng.uniform(-1.0, 1.0, n // 10 + 1), 10)[:n]
    smooth = np.convolve(steps, np.ones(6) / 6.0, mode="same")
    return size * smooth / np.abs(smooth).max()


def ids(rudder: np.ndarray, aileron: np.ndarray, unit: float = 1.0, mode=None) -> list[str]:
    mode = np.zeros(len(rudder)) if mode is None else mode
    found = excitation(rudder, aileron, mode, unit, TS)
    strokes = found.whole.max(initial=0.0), found.own.max(initial=0.0)
    return [reason.id for reason in excitation_reasons(*strokes)]


def test_the_rudder_is_excited_if_it_moved_within_some_five_seconds():
    drift = np.linspace(-0.3, 0.3, 40 * 60 * 20)  # half an hour of trimming
    doublet = np.zeros(40 * 60 * 20)
    doublet[1000:1020], doublet[1020:1040] = 0.2, -0.2
    step_after_a_hole = np.full(400, np.nan)
    step_after_a_hole[::4] = 0.3 * np.linspace(0.0, 1.0, 100)

    assert ids(drift, np.full(len(drift), np.nan)) == ["not_excited"]
    assert ids(doublet, np.full(len(doublet), np.nan)) == []
    assert ids(step_after_a_hole, np.full(400, np.nan)) == []
    assert ids(np.full(10, np.nan), np.full(10, np.nan)) == ["not_excited"]
    for unit, stroke in ((1.0, 0.09), (1.0, 0.11), (0.35, 0.09), (0.35, 0.11)):
        least = np.where((doublet > 0.0)[:2000], stroke * unit, 0.0)
        assert ids(least, UNKNOWN, unit) == (["not_excited"] if stroke < 0.1 else [])


@given(
    share=st.floats(0.2, 1.5),
    lag=st.integers(0, 5),
    own=st.floats(0.0, 0.02),
    seed=st.integers(0, 9),
)
def test_a_rudder_mixed_from_the_aileron_has_no_part_of_its_own(share, lag, own, seed):
    aileron = moving(seed, 0.6)
    rudder = share * np.roll(aileron, lag) + moving(seed + 100, own) if own else share * aileron

    found = excitation(rudder, aileron, UNKNOWN, 1.0, TS)

    assert found.whole.max() > LEAST_STROKE
    assert found.own.max() < LEAST_STROKE
    assert ids(rudder, aileron) == ["mixed_rudder"]


@given(share=st.floats(-1.0, 1.0), seed=st.integers(0, 9))
def test_a_rudder_that_moves_on_top_of_the_mix_is_excited(share, seed):
    aileron = moving(seed, 0.6)

    assert ids(share * aileron + moving(seed + 50, 0.15), aileron) == []


def test_the_mix_is_found_again_when_the_mode_changes():
    aileron = moving(3, 0.6, 8 * 1200)
    mode = np.repeat([0.0, 10.0], [4321, 8 * 1200 - 4321])

    assert ids(0.05 * mode * aileron, aileron, mode=mode) == ["mixed_rudder"]


@pytest.mark.parametrize("aileron", [UNKNOWN, np.zeros(2000)])
def test_an_aileron_that_is_unknown_or_stands_still_leaves_the_whole_rudder(aileron):
    found = excitation(moving(1, 0.3), aileron, UNKNOWN, 1.0, TS)

    np.testing.assert_array_equal(found.own, found.whole)


def test_the_own_part_is_what_least_squares_on_the_ailerons_lags_leaves():
    aileron, extra = moving(5, 0.4), moving(6, 0.1)
    rudder = 0.3 * aileron + 0.2 * np.roll(aileron, 4) + extra

    own = own_part(rudder, aileron, UNKNOWN, TS)

    assert np.isnan(own[:6]).all()
    known = np.isfinite(own)
    assert np.corrcoef(own[known], extra[known])[0, 1] > 0.95
    assert abs(np.corrcoef(own[known], aileron[known])[0, 1]) < 0.01


@pytest.mark.parametrize("n", [1, 2, 7, 14])
def test_a_record_shorter_than_the_lags_has_no_part_of_its_own(n):
    """As a memory of a millisecond leaves."""
    rudder, aileron = moving(1, 0.3, 20)[:n], moving(2, 0.3, 20)[:n]

    assert len(excitation(rudder, aileron, np.zeros(n), 1.0, TS).own) == n
    assert not np.isfinite(own_part(rudder, aileron, np.zeros(n), TS)).any()
