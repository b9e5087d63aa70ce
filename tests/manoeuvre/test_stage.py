"""The stage: samples in blocks of any size, the same answers of manoeuvres and of the flight."""

from __future__ import annotations

import numpy as np
import pytest
from drawn import examples
from hypothesis import given
from hypothesis import strategies as st
from manoeuvre.streams import TS_S, WN, cut, doublets, flown, rest, stream, yawing

from yawid.answers.run_summary import Flight, Manoeuvre
from yawid.config.run import RunConfig
from yawid.manoeuvre.judge import ManoeuvreSetting
from yawid.manoeuvre.stage import Manoeuvres

RUDDER = flown(rest(12), doublets(4), rest(15), doublets(3, 0.3), rest(12))
SAMPLES = stream(RUDDER, y=yawing(RUDDER, noise=0.003), roll=0.01 * np.sin(RUDDER.cumsum()))


def answers(edges: list[int]) -> tuple[list[Manoeuvre], list[Flight]]:
    stage = Manoeuvres(ManoeuvreSetting(RunConfig(), TS_S, (20.0, 20.0), (3, 1)))
    for block in cut(SAMPLES, edges):
        stage.feed(block, {})
    stage.finish()
    return list(stage.ready()), stage.flights([])


WHOLE = answers([])


def test_two_manoeuvres_of_one_aircraft_are_one_flight():
    manoeuvres, [flight] = WHOLE

    assert [each.verdict.usable for each in manoeuvres] == [True, True]
    assert flight.used == [1, 2]
    assert flight.dutch_roll.wn_rad_s == pytest.approx(WN, rel=0.01)


@examples(4)
@given(edges=st.lists(st.integers(0, len(SAMPLES)), max_size=40))
def test_where_the_stream_is_cut_into_blocks_changes_no_answer(edges: list[int]):
    assert answers(edges) == WHOLE


def test_sample_by_sample_the_answers_are_the_same_to_the_bit():
    assert answers(list(range(len(SAMPLES)))) == WHOLE
