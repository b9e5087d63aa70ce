"""Where manoeuvres begin and end (DESIGN.md, section 6), rule by rule on streams made for it."""

import pickle
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from manoeuvre.streams import (
    HZ,
    TS_S,
    assert_same,
    cut,
    doublets,
    flown,
    found_in,
    joined,
    rest,
    spans,
    stream,
    without,
)
from yawid.manoeuvres.answer import ManoeuvreSetting
from yawid.manoeuvres.find import Finder, Stated
from yawid.manoeuvres.stage import Manoeuvres

from yawid.blocks import SampleBlock
from yawid.config.run import RunConfig

BEGIN, END = 20 * HZ, 30 * HZ
"""k of the first row that moves, and of the first that rests again, in :func:`usual`."""
USUAL = [(BEGIN - HZ, END + 5 * HZ - 1)]


def usual(amplitude: float = 0.2) -> np.ndarray:
    return flown(rest(20), doublets(10, amplitude), rest(20))


def test_it_begins_one_second_before_the_first_movement_and_ends_after_five_of_rest():
    assert spans(found_in(stream(usual()))) == USUAL


def test_what_rests_wherever_it_rests_is_at_rest():
    """A trim, and another one afterwards: rest is where it stood, not the middle"""
    rudder = flown(rest(20, 0.3), doublets(10) + 0.3, rest(20, -0.1))
    assert spans(found_in(stream(rudder))) == USUAL


@pytest.mark.parametrize(("pause_s", "count"), [(4.9, 1), (5.1, 2)])
def test_rest_of_five_seconds_divides(pause_s: float, count: int):
    rudder = flown(rest(20), doublets(10), rest(pause_s), doublets(10), rest(20))
    assert len(found_in(stream(rudder))) == count


def ringing(seconds: float, then: float = 25.0) -> np.ndarray:
    """A yaw rate that moves by 2 with the rudder, by 1 for these seconds after, and rests"""
    return flown(rest(20), doublets(10, 1.0), doublets(seconds, 0.5), rest(then - seconds))


@pytest.mark.parametrize(
    ("rings_s", "rest_s"), [(0.0, 5.0), (6.0, 10.0), (8.0, 12.0), (20.0, 15.0)]
)
def test_it_ends_when_the_yaw_rate_has_moved_little_for_four_seconds_too_or_after_fifteen(
    rings_s: float, rest_s: float
):
    rudder = flown(rest(20), doublets(10), rest(25))
    found = found_in(stream(rudder, y=ringing(rings_s)))
    assert spans(found) == [(BEGIN - HZ, END + round(rest_s * HZ) - 1)]


def test_a_yaw_rate_that_moves_by_a_tenth_has_decayed():
    rudder, y = flown(rest(20), doublets(10), rest(25)), ringing(0.0)
    y[END:] = 0.099 * doublets(25, 1.0)
    assert spans(found_in(stream(rudder, y=y))) == USUAL
    y[END:] = 0.11 * doublets(25, 1.0)
    assert spans(found_in(stream(rudder, y=y))) == [(USUAL[0][0], END + 15 * HZ - 1)]


def test_a_turn_that_follows_is_no_decay_to_wait_for():
    rudder, y = flown(rest(20), doublets(10), rest(25)), ringing(0.0)
    y[END:] = np.linspace(0.0, 3.0, 25 * HZ)
    turn = np.where(np.arange(len(y)) < END, 0.0, y)
    assert spans(found_in(stream(rudder, y=y, turn=turn))) == USUAL
    assert spans(found_in(stream(rudder, y=y))) != USUAL


def test_a_rudder_that_moves_again_ends_the_wait_and_takes_its_newest_second():
    rudder = flown(rest(20), doublets(10), rest(9), doublets(6), rest(10))
    y = flown(rest(20), doublets(35, 1.0))
    again = END + 9 * HZ
    found = found_in(stream(rudder, y=y))
    assert spans(found) == [(BEGIN - HZ, again - HZ - 1), (again - HZ, len(rudder) - 1)]


def test_a_second_one_begins_no_earlier_than_the_first_ended():
    rudder = flown(rest(20), doublets(10), rest(5.1), doublets(10), rest(20))
    first, second = spans(found_in(stream(rudder)))
    assert first[1] < second[0]


def test_a_stream_that_begins_in_the_middle_of_one_begins_there():
    assert spans(found_in(stream(flown(doublets(10), rest(20))))) == [(0, 15 * HZ - 1)]


def test_a_stream_that_ends_in_the_middle_of_one_ends_it():
    found = found_in(stream(flown(rest(20), doublets(10))))
    assert spans(found) == [(BEGIN - HZ, END - 1)]


@pytest.mark.parametrize(("amplitude", "count"), [(0.051, 1), (0.049, 0)])
def test_less_than_a_tenth_of_half_the_travel_within_five_seconds_is_none(
    amplitude: float, count: int
):
    assert len(found_in(stream(usual(amplitude)))) == count


def test_travel_is_counted_in_its_own_unit():
    samples = stream(0.4 * usual(0.051))
    assert found_in(samples) == []
    assert spans(found_in(samples, unit=0.4)) == USUAL


@pytest.mark.parametrize("range_s", [60.0, 600.0])
def test_a_drift_of_the_trim_is_none(range_s: float):
    rudder = flown(rest(20), np.linspace(0.0, 0.3, round(range_s * HZ)), rest(20, 0.3))
    assert found_in(stream(rudder)) == []


def test_noise_of_two_percent_is_rest():
    noise = 0.01 * np.random.default_rng(1).uniform(-1.0, 1.0, 50 * HZ)
    assert spans(found_in(stream(usual() + noise))) == USUAL


@pytest.mark.parametrize(("gap_s", "count"), [(2.0, 1), (2.1, 2)])
@pytest.mark.parametrize("as_held", [True, False])
def test_a_gap_of_two_seconds_lies_inside_and_a_longer_one_ends_it(
    gap_s: float, count: int, as_held: bool
):
    first, stop = 25 * HZ, 25 * HZ + round(gap_s * HZ) - 1
    rudder = flown(rest(20), doublets(15), rest(20))
    if as_held:
        rudder[first:stop] = np.nan
        samples = stream(rudder)
    else:
        samples = without(stream(rudder), first, stop)
    found = found_in(samples)

    assert len(found) == count
    assert found[0].k[0] == BEGIN - HZ
    assert found[-1].k[-1] == 40 * HZ - 1
    if count == 2:
        used = [each.k[each.held == 0] for each in found]
        assert used[0][-1] == first - 1
        assert used[1][0] == stop


@pytest.mark.parametrize("what", ["mode", "epoch"])
def test_another_mode_or_meaning_ends_it(what: str):
    rudder, at = flown(rest(20), doublets(10), rest(20)), 25 * HZ
    later = {"mode": {"mode": 5.0}, "epoch": {"epoch": 1}}[what]
    samples = joined(stream(rudder[:at]), stream(rudder[at:], first_k=at, **later))

    assert spans(found_in(samples)) == [(BEGIN - HZ, at - 1), (at, END + 5 * HZ - 1)]


def test_a_mode_that_becomes_known_is_another():
    rudder, at = usual(), 25 * HZ
    samples = joined(stream(rudder[:at], mode=np.nan), stream(rudder[at:], first_k=at))
    assert len(found_in(samples)) == 2
    assert spans(found_in(stream(rudder, mode=np.nan))) == USUAL


@pytest.mark.parametrize("at_k", [0, 100])
def test_a_reboot_ends_it(at_k: int):
    rudder, at = usual(), 25 * HZ
    samples = joined(stream(rudder[:at]), stream(rudder[at:], first_k=at_k))
    found = spans(found_in(samples))

    assert found == [(BEGIN - HZ, at - 1), (at_k, at_k + 10 * HZ - 1)]


def test_after_120_seconds_the_rest_is_the_next():
    found = found_in(stream(flown(rest(20), doublets(300), rest(20))))

    assert [len(each) for each in found[:2]] == [120 * HZ, 120 * HZ]
    k = np.concatenate([each.k for each in found])
    np.testing.assert_array_equal(k, np.arange(BEGIN - HZ, 325 * HZ))


def test_a_longer_gap_counts_into_120_seconds_by_the_clock():
    samples = without(stream(flown(rest(20), doublets(200), rest(20))), 60 * HZ, 61 * HZ)
    assert found_in(samples)[0].k[-1] == BEGIN - HZ + 120 * HZ - 1


@pytest.mark.parametrize(("share", "count"), [(1.08, 1), (0.92, 1), (1.15, 2), (0.85, 2)])
def test_another_airspeed_ends_it(share: float, count: int):
    rudder = flown(rest(20), doublets(60), rest(20))
    airspeed = np.where(np.arange(len(rudder)) < 50 * HZ, 20.0, 20.0 * share)
    found = found_in(stream(rudder, airspeed=airspeed))

    assert len(found) == count
    if count == 2:
        first, second = found
        assert abs(first.k[-1] - 53 * HZ) < 3 * HZ  # the newest 5 s are of both speeds until then
        assert second.k[0] == first.k[-1] + 1


@pytest.mark.parametrize("goes", [lambda t: 5.0 + 1.6 * t, lambda t: 20.0 - 3.0 * t])
def test_another_airspeed_ends_it_within_its_first_five_seconds_too(
    goes,
):
    """A take-off roll, and a flare: the mean of five seconds is still that of all of it"""
    rudder = flown(rest(1), doublets(4))
    speed = goes(np.arange(len(rudder)) / HZ)
    first = found_in(stream(rudder, airspeed=speed))[0]

    means = np.convolve(first.airspeed, np.full(2 * HZ, 0.5 / HZ), "valid")
    factors = np.maximum(means / means[0], means[0] / means)
    assert len(first) < 5 * HZ
    assert factors[:-1].max() <= 1.3
    assert spans(found_in(stream(rudder, airspeed=10.0))) == [(0, len(rudder) - 1)]


def test_a_gust_of_a_second_is_no_other_airspeed():
    rudder = flown(rest(20), doublets(60), rest(20))
    airspeed = np.full(len(rudder), 20.0)
    airspeed[50 * HZ : 51 * HZ] = 26.0
    assert len(found_in(stream(rudder, airspeed=airspeed))) == 1


def test_an_unknown_airspeed_ends_nothing():
    rudder = usual()
    airspeed = np.where(np.arange(len(rudder)) % 3 == 0, 20.0, np.nan)
    assert spans(found_in(stream(rudder, airspeed=airspeed))) == USUAL
    assert spans(found_in(stream(rudder, airspeed=np.nan))) == USUAL


def weave(seconds: float, seed: int = 3) -> np.ndarray:
    """An aileron that flies: noise of some seconds' memory, a tenth of the travel"""
    noise, value = np.random.default_rng(seed).normal(size=round(seconds * HZ)), 0.0
    found = []
    for each in noise:
        value = 0.95 * value + 0.05 * each
        found.append(value)
    return np.array(found)


@pytest.mark.parametrize("late", [0, 2, 4])
@pytest.mark.parametrize("share", [0.5, -2.0])
def test_a_rudder_that_is_the_ailerons_copy_is_none(late: int, share: float):
    """Also where the mixer, or the pilot, is 0.1 or 0.2 s late"""
    aileron = weave(120.0)
    rudder = share * np.concatenate([np.zeros(late), aileron[: len(aileron) - late]])
    samples = stream(rudder, aileron=aileron)

    assert np.ptp(rudder) > 0.1
    assert found_in(samples) == []
    assert len(found_in(stream(rudder))) > 0


def test_its_own_part_beside_a_copy_is_one():
    aileron = 0.1 * weave(50.0)
    own = usual()
    samples = stream(own + 0.5 * aileron, aileron=aileron)

    assert np.ptp(aileron) > 0.05
    ((first, last),) = spans(found_in(samples))
    assert abs(first - USUAL[0][0]) <= HZ // 4
    assert abs(last - USUAL[0][1]) <= HZ // 4


def test_an_aileron_at_rest_takes_nothing_from_the_rudder():
    assert spans(found_in(stream(usual(), aileron=0.1))) == USUAL


def test_a_manoeuvre_in_the_first_seconds_is_found_when_the_mix_is_known():
    """Until then it is waited for; nothing of it is lost"""
    rudder = flown(rest(1), doublets(10), rest(30))
    aileron = weave(41.0)
    ((first, last),) = spans(found_in(stream(rudder, aileron=aileron)))
    assert first == 0
    assert abs(last - 16 * HZ) <= 2 * HZ


EVENTS = st.sampled_from(["none", "gap", "mode", "no mode", "epoch", "reboot", "speed"])
PIECES = st.lists(
    st.fixed_dictionaries(
        {
            "n": st.integers(1, 500),
            "seed": st.integers(0, 99),
            "kind": st.sampled_from(["rest", "moves", "drift", "noise"]),
            "amplitude": st.sampled_from([0.03, 0.06, 0.3]),
            "aileron": st.sampled_from([np.nan, 0.0, 0.05]),
            "mixed": st.sampled_from([0.0, 0.5]),
            "held": st.lists(st.tuples(st.integers(0, 500), st.integers(1, 90)), max_size=2),
            "aileron_from": st.sampled_from([0, 30]),
            "rings": st.sampled_from([0.0, 1.0]),
            "speed_unknown": st.sampled_from([0.0, 0.3]),
            "then": EVENTS,
            "by": st.floats(0.0, 1.0),
        }
    ),
    min_size=1,
    max_size=7,
)
"""Minutes of rest and movement, with all that may happen between two samples"""


def piece(told: dict[str, Any], **options: Any) -> SampleBlock:
    n, rng = told["n"], np.random.default_rng(told["seed"])
    rudder = {
        "rest": np.full(n, 0.1),
        "moves": told["amplitude"] * np.sin(np.arange(n) / 4.0),
        "drift": np.linspace(0.0, 0.3, n),
        "noise": 0.02 * rng.normal(size=n),
    }[told["kind"]]
    aileron = told["aileron"] * rng.normal(size=n).cumsum()
    rudder = rudder + told["mixed"] * np.nan_to_num(aileron)
    for at, length in told["held"]:
        rudder[at : at + length] = np.nan
    aileron[: told["aileron_from"]] = np.nan
    speed = np.where(rng.random(n) < told["speed_unknown"], np.nan, options.pop("airspeed"))
    y = told["rings"] * rng.normal(size=n).cumsum()
    return stream(rudder, aileron=aileron, airspeed=speed, y=y, **options)


def built(pieces: list[dict[str, Any]]) -> SampleBlock:
    parts, k, mode, epoch, speed = [], 5000, 0.0, 0, 20.0
    for told in pieces:
        parts.append(piece(told, first_k=k, airspeed=speed, mode=mode, epoch=epoch))
        k, event, by = k + told["n"], told["then"], told["by"]
        k += round(120 * by) if event == "gap" else 0
        k = round((k - 2) * by) if event == "reboot" else k
        mode = {"mode": 5.0, "no mode": np.nan}.get(event, mode)
        epoch += event == "epoch"
        speed *= 0.8 + 0.5 * by if event == "speed" else 1.0
    return joined(*parts)


EDGES = st.lists(st.integers(0, 3500), max_size=30)


@settings(deadline=None, max_examples=30)
@given(pieces=PIECES, edges=EDGES)
def test_where_the_stream_is_cut_into_blocks_changes_nothing(
    pieces: list[dict[str, Any]], edges: list[int]
):
    samples = built(pieces)
    assert_same(found_in(samples, edges), found_in(samples))


@settings(deadline=None, max_examples=2)
@given(pieces=PIECES)
def test_sample_by_sample_is_the_same_too(pieces: list[dict[str, Any]]):
    samples = built(pieces)
    assert_same(found_in(samples, range(len(samples))), found_in(samples))


@settings(deadline=None, max_examples=15)
@given(pieces=PIECES)
def test_each_is_a_piece_of_the_stream_as_it_came(pieces: list[dict[str, Any]]):
    """In order, once each, no row invented, none longer than 120 s, one boot, mode and epoch"""
    samples, at = built(pieces), 0
    number = np.arange(len(samples), dtype=float)  # a column that names each row
    for each in found_in(replace(samples, yaw=number)):
        rows = each.yaw.astype(int)
        assert rows[0] >= at
        np.testing.assert_array_equal(rows, np.arange(rows[0], rows[0] + len(rows)))
        at = rows[-1] + 1
        assert np.all(np.diff(each.k) >= 1)
        assert each.k[-1] - each.k[0] < 120 * HZ
        assert len(np.unique(each.epoch)) == 1
        assert len(np.unique(np.nan_to_num(each.mode, nan=-1.0))) == 1
        assert np.all(np.diff(each.k[each.held == 0]) <= 2 * HZ)


@settings(deadline=None, max_examples=12)
@given(pieces=PIECES, stop=st.integers(1, 3500))
def test_what_has_been_found_depends_on_nothing_that_comes_later(
    pieces: list[dict[str, Any]], stop: int
):
    samples = built(pieces)
    early = Finder(TS_S, 1.0).feed(samples.select(slice(0, stop)))
    assert_same(early, found_in(samples)[: len(early)])


def kept_bytes(finder: Finder) -> int:
    return len(pickle.dumps(finder))


LONG = {
    "movement": lambda n, rng: stream(doublets(n / HZ)),
    "rest": lambda n, rng: stream(rest(n / HZ)),
    "nothing usable": lambda n, rng: stream(rest(n / HZ, np.nan)),
    "movement, aileron moving": lambda n, rng: stream(
        doublets(n / HZ), aileron=rng.normal(size=n).cumsum() / 50.0
    ),
    "sparse aileron": lambda n, rng: stream(
        doublets(n / HZ), aileron=np.where(np.arange(n) % 20, np.nan, rng.normal(size=n))
    ),
    "every other sample held": lambda n, rng: stream(
        np.where(np.arange(n) % 2, doublets(n / HZ), np.nan), aileron=rng.normal(size=n)
    ),
    "drift": lambda n, rng: stream(np.linspace(0.0, 1.0, n)),
}


@pytest.mark.parametrize("kind", LONG)
def test_what_is_kept_is_bounded_however_long_it_flies(kind: str):
    """As pickled bytes of all that the finder holds: 146 s of rows are 20 s * 3 and 126 s * 18"""
    n = 350 * HZ
    samples, finder = LONG[kind](n, np.random.default_rng(1)), Finder(TS_S, 1.0)
    largest = 0
    for block in cut(samples, range(0, n, 97 * HZ)):
        finder.feed(block)
        largest = max(largest, kept_bytes(finder))
    row = 19 * 8
    assert largest < 1.3 * row * (146 + 1) * HZ


@pytest.mark.parametrize(("low_s", "high_s"), [(10.0, 40.0), (0.0, 600.0)])
def test_a_stretch_that_was_named_is_exactly_one(low_s: float, high_s: float):
    config = RunConfig(from_s=low_s, to_s=high_s)
    stage = Manoeuvres(ManoeuvreSetting(config, TS_S, (20.0, 20.0), (3, 1)))
    assert isinstance(stage._finder, Stated)
    samples = joined(stream(usual()), stream(usual(), first_k=2000, mode=5.0, epoch=1))
    for block in cut(samples, [7, 300, 1500]):
        stage.feed(block)
    stage.finish()
    (answered,) = stage.ready()
    assert answered.found.duration_s == pytest.approx((2000 + 999) * TS_S)


@pytest.mark.parametrize(
    "window", [{}, {"from_s": 10.0}, {"to_s": 300.0}, {"from_s": 0.0, "to_s": 600.1}]
)
def test_a_stretch_that_is_open_or_longer_is_searched(window: dict[str, float]):
    stage = Manoeuvres(ManoeuvreSetting(RunConfig(**window), TS_S, (20.0, 20.0), (3, 1)))
    assert isinstance(stage._finder, Finder)


def test_a_named_stretch_without_a_sample_is_none():
    assert Stated().finish() == []


def test_how_a_manoeuvre_on_its_way_stands_is_known_and_looking_changes_nothing():
    finder = Finder(TS_S, 1.0)
    samples = stream(flown(rest(20), doublets(10), rest(20)))
    seen, found = [], []
    for first in range(0, len(samples), HZ):
        found += finder.feed(samples.select(slice(first, first + HZ)))
        seen.append(finder.progress(closely=True))
    assert spans(found) == USUAL
    before, moving, resting, after = (seen[i] for i in (18, 27, 32, 40))
    assert (before.from_s, before.stroke) == (None, pytest.approx(0.0))
    assert moving.is_excited
    assert moving.stroke == pytest.approx(0.4)
    assert moving.from_s == samples.boot_us[BEGIN - HZ] / 1e6
    assert resting.from_s == moving.from_s
    assert 2.0 < resting.rests_s < 5.0
    assert after.from_s is None
