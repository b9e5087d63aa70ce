"""Where manoeuvres begin and end, rule by rule, on streams made for it."""

from __future__ import annotations

import math
import pickle
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
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
    yawing,
)
from scipy.signal import lfilter

from yawid.blocks import Floats, SampleBlock
from yawid.manoeuvre.find import Finder, UnderWay, speed_factor
from yawid.results.judge_samples import excitation_reasons

BEGIN, END = 20 * HZ, 30 * HZ
"""k of the first row that moves, and of the first that rests again, in :func:`usual`."""
USUAL = [(BEGIN - HZ, END + 5 * HZ - 1)]
MANUAL = 0.0


def usual(amplitude: float = 0.2) -> Floats:
    return flown(rest(20), doublets(10, amplitude), rest(20))


def reasons_of(samples: SampleBlock) -> list[tuple[str, str]]:
    finder = Finder(TS_S, 1.0)
    assert finder.feed(samples) + finder.finish() == []
    return [(each.id, each.text) for each in excitation_reasons(finder.most_whole, finder.most_own)]


def at_25_s(**later: Any) -> SampleBlock:
    """The usual flight, with something else from the middle of its movement on."""
    rudder, at = usual(), 25 * HZ
    later = {"first_k": at} | later
    return joined(stream(rudder[:at]), stream(rudder[at:], **later))


def ended(first_k: int = 25 * HZ) -> list[tuple[int, int]]:
    """The spans where that ends a manoeuvre and begins the next."""
    return [(BEGIN - HZ, 25 * HZ - 1), (first_k, first_k + 10 * HZ - 1)]


def ringing(seconds: float, period_s: float, share: float = 0.5) -> Floats:
    """A yaw rate that moves by 2 with the rudder, then by twice ``share``, and rests"""
    t = np.arange(round(HZ * seconds)) / HZ
    after = share * np.sin(2.0 * math.pi * t / period_s)
    return flown(rest(20), doublets(10, 1.0), after, rest(60.0 - seconds))


def twice(pause_s: float, period_s: float | None = None) -> SampleBlock:
    """Two movements, after the first of which the yaw rate rings with a period, or is 0."""
    rudder = flown(rest(20), doublets(10), rest(pause_s), doublets(10), rest(40))
    if period_s is None:
        return stream(rudder)
    y = ringing(60.0, period_s)
    return stream(rudder, y=flown(y, y[END:])[: len(rudder)])


def speeds(share: float) -> SampleBlock:
    """A minute of movement, with another airspeed after half of it."""
    rudder = flown(rest(20), doublets(60), rest(20))
    return stream(rudder, airspeed=np.where(np.arange(len(rudder)) < 50 * HZ, 20.0, 20.0 * share))


def gap(seconds: float, *, held: bool) -> SampleBlock:
    """Fifteen seconds of movement without a usable sample, or without any, for some time."""
    rudder, first = flown(rest(20), doublets(15), rest(20)), 25 * HZ
    stop = first + round(seconds * HZ) - 1
    if not held:
        return without(stream(rudder), first, stop)
    rudder[first:stop] = np.nan
    return stream(rudder)


def stilled(rings_s: float) -> Floats:
    """A yaw rate that rings with a period of 8 s, and then stands."""
    y = ringing(rings_s, 8.0)
    y[END:] -= y[END + round(rings_s * HZ) - 1] if rings_s else 0.0
    y[END + round(rings_s * HZ) :] = 0.0
    return y


def weave(seconds: float, seed: int = 3) -> Floats:
    """An aileron that flies: noise of some seconds' memory, a tenth of the travel"""
    noise = np.random.default_rng(seed).standard_normal(round(seconds * HZ))
    return np.asarray(lfilter([0.05], [1.0, -0.95], noise))


def next_to_a_copy(own: Floats, aileron: Floats) -> SampleBlock:
    return stream(own + 0.5 * aileron, aileron=aileron)


def slow_then_by_script() -> SampleBlock:
    """A doublet of a slow mode rings; the rudder then moves 0.6 s before MANUAL is known."""
    rudder = flown(rest(20), doublets(2), rest(8), np.full(5, -0.3), np.full(5, 0.3), rest(30))
    mode = np.where(np.arange(len(rudder)) < 30 * HZ + 12, 5.0, MANUAL)
    return stream(rudder, y=yawing(rudder, wn=1.0, zeta=0.05), mode=mode)


def rolling(from_m_s: float, by_m_s2: float) -> SampleBlock:
    """A take-off roll, or a flare: the mean of its five seconds is that of all of it."""
    return stream(flown(rest(1), doublets(4)), airspeed=from_m_s + by_m_s2 * np.arange(100) / HZ)


LONG_REST = flown(rest(20), doublets(10), rest(60))
GUST = flown(rest(50, 20.0), rest(1, 26.0), rest(49, 20.0))
TURN = flown(rest(30), np.linspace(0.0, 6.0, 60 * HZ))
"""Spans of k, or how many there are; a stream in half travels."""
SPANS: dict[str, tuple[SampleBlock, list[tuple[int, int]] | int]] = {
    "one second before the first movement, five of rest after it": (stream(usual()), USUAL),
    **{
        f"bounds are whole seconds: {late} samples late": (
            stream(flown(np.zeros(late), usual())), [(USUAL[0][0], USUAL[0][1] + HZ)],
        )
        for late in (1, 7, 19)
    },
    "rest is where the rudder stands": (
        stream(flown(rest(20, 0.3), doublets(10) + 0.3, rest(20, -0.1))), USUAL,
    ),
    "a stream begins in the middle of one": (
        stream(flown(doublets(10), rest(20))), [(0, 15 * HZ - 1)],
    ),
    "a stream ends in the middle of one": (
        stream(flown(rest(20), doublets(10))), [(BEGIN - HZ, END - 1)],
    ),
    "more than a tenth of half the travel": (stream(usual(0.051)), 1),
    "less than a tenth of half the travel": (stream(usual(0.049)), 0),
    "a trim that drifts for a minute": (
        stream(flown(rest(20), np.linspace(0.0, 0.3, 60 * HZ), rest(20, 0.3))), 0,
    ),
    "a trim that drifts for ten": (
        stream(flown(rest(20), np.linspace(0.0, 0.3, 600 * HZ), rest(20, 0.3))), 0,
    ),
    "noise of two percent is rest": (
        stream(usual() + 0.01 * np.random.default_rng(1).uniform(-1.0, 1.0, 50 * HZ)), USUAL,
    ),
    "another mode ends it": (at_25_s(mode=5.0), ended()),
    "a mode that becomes unknown ends it": (at_25_s(mode=np.nan), ended()),
    "a mode that stays unknown ends nothing": (stream(usual(), mode=np.nan), USUAL),
    "another meaning of the rudder ends it": (at_25_s(epoch=1), ended()),
    "a reboot ends it": (at_25_s(first_k=0), ended(0)),
    "a reboot of which some samples are lost ends it": (at_25_s(first_k=100), ended(100)),
    "an aileron at rest takes nothing from the rudder": (stream(usual(), aileron=0.1), USUAL),
    "an unknown airspeed ends nothing": (stream(usual(), airspeed=np.nan), USUAL),
    "nor does one that is known at times": (
        stream(usual(), airspeed=np.where(np.arange(50 * HZ) % 3 == 0, 20.0, np.nan)), USUAL,
    ),
    "a gust of a second is no other airspeed": (
        stream(flown(rest(20), doublets(60), rest(20)), airspeed=GUST), 1,
    ),
    **{f"an airspeed by {share}": (speeds(share), 1) for share in (1.08, 0.92)},
    # The newest 5 s are of both speeds for as long.
    **{
        f"another airspeed, by {share}, ends it": (
            speeds(share), [(BEGIN - HZ, 53 * HZ - 1), (53 * HZ, 85 * HZ - 1)],
        )
        for share in (1.15, 0.85)
    },
    # So far first and last airspeed differ by a factor of 1.3 at most.
    **{
        f"{name} ends it within its first five seconds": (
            rolling(from_m_s, by_m_s2), [(0, 3 * HZ - 1), (3 * HZ, 5 * HZ - 1)],
        )
        for name, from_m_s, by_m_s2 in (("a take-off roll", 5.0, 1.6), ("a flare", 20.0, -3.0))
    },
    "five seconds at one airspeed are one": (rolling(10.0, 0.0), [(0, 99)]),
    **{
        f"a gap of {seconds} s, {'held' if held else 'missing'}": (gap(seconds, held=held), found)
        for seconds, held, found in (
            (2.0, True, [(BEGIN - HZ, 40 * HZ - 1)]),
            (2.0, False, [(BEGIN - HZ, 40 * HZ - 1)]),
            (2.1, True, [(BEGIN - HZ, 25 * HZ + 40), (25 * HZ + 41, 40 * HZ - 1)]),
            (2.1, False, [(BEGIN - HZ, 25 * HZ - 1), (25 * HZ + 41, 40 * HZ - 1)]),
        )
    },
    "after 120 s the rest is the next": (
        stream(flown(rest(20), doublets(300), rest(20))),
        [(19 * HZ, 139 * HZ - 1), (139 * HZ, 259 * HZ - 1), (259 * HZ, 325 * HZ - 1)],
    ),
    "a gap counts into them by the clock": (
        without(stream(flown(rest(20), doublets(200), rest(20))), 60 * HZ, 61 * HZ),
        [(19 * HZ, 139 * HZ - 1), (139 * HZ, 225 * HZ - 1)],
    ),
    "a rest of four seconds divides nothing": (twice(4.0), 1),
    "a rest of six seconds divides": (twice(6.0), 2),
    "a movement belongs to it until 2.5 periods of 4 s have passed": (twice(9.0, 4.0), 1),
    "and begins the next after them": (
        twice(12.0, 4.0),
        [(BEGIN - HZ, END + 10 * HZ - 1), (END + 11 * HZ, END + 32 * HZ - 1)],
    ),
    "a yaw rate that swings by less than a tenth has decayed": (
        stream(LONG_REST, y=ringing(60.0, 6.0, 0.099)), USUAL,
    ),
    "one that swings by more has not": (
        stream(LONG_REST, y=ringing(60.0, 6.0, 0.12)), [(BEGIN - HZ, END + 15 * HZ - 1)],
    ),
    **{
        f"2.5 periods of {period_s} s end it, by zero crossings {seconds} s": (
            stream(LONG_REST, y=ringing(60.0, period_s, 1.0)),
            [(BEGIN - HZ, END + seconds * HZ - 1)],
        )
        for period_s, seconds in ((1.0, 5), (4.0, 10), (6.0, 15), (10.0, 24), (14.0, 33))
    },
    # A period of 8 s is known by two crossings, which half of it has not.
    **{
        f"four seconds of a yaw rate that stands end it, after {rings_s} s": (
            stream(LONG_REST, y=stilled(rings_s)), [(BEGIN - HZ, END + seconds * HZ - 1)],
        )
        for rings_s, seconds in ((0.0, 5), (4.0, 8), (6.0, 9))
    },
    "a turn that follows is no decay to wait for": (
        stream(LONG_REST, y=ringing(0.0, 1.0) + TURN, turn=TURN), USUAL,
    ),
    # Where the bank is unknown r crosses no zero: 2.5 periods of the longest, 15 s, are 37.5 s.
    "a turn of an unknown bank": (
        stream(LONG_REST, y=np.where(TURN > 0.0, TURN, ringing(0.0, 1.0))),
        [(USUAL[0][0], END + 38 * HZ - 1)],
    ),
    "its own part next to a copy of the aileron is one": (
        next_to_a_copy(usual(), 0.1 * weave(50.0)), USUAL,
    ),
    # How the rudder follows takes 5.6 s to know: where it begins is decided then.
    "nothing is lost before the mix is known": (
        next_to_a_copy(flown(rest(3), doublets(10), rest(30)), weave(43.0)),
        [(0, 28 * HZ - 1)],
    ),
    "a doublet that rings as a bare mode is reported ends before its movement": (
        slow_then_by_script(), [(BEGIN - HZ, 29 * HZ - 1), (29 * HZ, 46 * HZ - 1)],
    ),
    "a movement that began long before a bare mode ends with the mode before": (
        stream(usual(), mode=np.where(np.arange(50 * HZ) < 25 * HZ, 5.0, MANUAL)), ended(),
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", SPANS)
def test_where_each_flights_manoeuvres_begin_and_end(name: str):
    samples, expected = SPANS[name]
    found = spans(found_in(samples, bare=MANUAL))
    assert (len(found) if isinstance(expected, int) else found) == expected


@pytest.mark.parametrize("zeta", [0.05, 0.3])
@pytest.mark.parametrize("gust", [0.0, 0.3, 0.5])
def test_doublets_every_fifteen_seconds_at_two_rad_s_are_one_manoeuvre_each_also_in_gusts(
    zeta: float, gust: float
):
    """``gust`` is the RMS of what gusts make of the yaw rate, in peaks of the doublets"""
    doublet = flown(np.full(31, 0.2), np.full(31, -0.2), np.zeros(15 * HZ - 62))
    rudder = flown(rest(20.3), *[doublet] * 8, rest(20))
    found = []
    for seed in range(3):
        y = yawing(rudder, wn=2.0, zeta=zeta)
        rng, old = np.random.default_rng(seed), math.exp(-TS_S / 3.0)
        air = lfilter([1.0 - old], [1.0, -old], rng.standard_normal(len(rudder)))
        moved = yawing(air, wn=2.0, zeta=zeta, lead_s=1e6)  # a steady side wind turns nothing
        y += np.abs(y).max() * (gust * moved / moved.std() + 0.01 * rng.standard_normal(len(y)))
        found += found_in(stream(rudder, y=y))
    assert 0.9 * 24 <= len(found) <= 24


def test_travel_is_counted_in_its_own_unit():
    samples = stream(0.4 * usual(0.051))
    assert found_in(samples) == []
    assert spans(found_in(samples, unit=0.4)) == USUAL


def test_the_factor_of_two_airspeeds_is_that_of_the_first_and_last_two_seconds_known():
    speeds = np.array([np.nan, 0.0, *[20.0] * 40, *[35.0] * 60, *[16.0] * 40, np.nan])
    assert speed_factor(speeds, TS_S) == pytest.approx(20.0 / 16.0)
    assert math.isnan(speed_factor(speeds[:42], TS_S))


@pytest.mark.parametrize("late", [0, 2, 4])
@pytest.mark.parametrize(("share", "seconds"), [(0.5, 120.0), (-2.0, 120.0), (2.5, 43.0)])
def test_a_rudder_that_is_a_copy_of_the_aileron_is_none(late: int, share: float, seconds: float):
    """Also where the mixer, or the pilot, is 0.1 or 0.2 s late"""
    aileron = weave(seconds)
    rudder = share * np.concatenate([np.zeros(late), aileron[: len(aileron) - late]])
    ((reason, text),) = reasons_of(stream(rudder, aileron=aileron))

    assert np.ptp(rudder) > 0.1
    assert reason == "mixed_rudder"
    assert "follows the aileron" in text
    assert len(found_in(stream(rudder))) > 0


def test_a_search_says_why_it_found_nothing():
    still = reasons_of(stream(usual(0.03)))
    assert still[0][0] == "not_excited"
    assert "within 5 s is 6.0 % of half its travel: at least 10 % is needed" in still[0][1]
    assert reasons_of(stream(rest(20, np.nan)))[0][0] == "not_excited"


EVENTS = st.sampled_from(["none", "gap", "mode", "no mode", "bare", "epoch", "reboot", "speed"])
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


def piece(drawn: dict[str, Any], speed: float, **options: Any) -> SampleBlock:
    n, rng = drawn["n"], np.random.default_rng(drawn["seed"])
    rudder = {
        "rest": np.full(n, 0.1),
        "moves": drawn["amplitude"] * np.sin(np.arange(n) / 4.0),
        "drift": np.linspace(0.0, 0.3, n),
        "noise": 0.02 * rng.normal(size=n),
    }[drawn["kind"]]
    aileron = drawn["aileron"] * rng.normal(size=n).cumsum()
    rudder = rudder + drawn["mixed"] * np.nan_to_num(aileron)
    for at, length in drawn["held"]:
        rudder[at : at + length] = np.nan
    aileron[: drawn["aileron_from"]] = np.nan
    airspeed = np.where(rng.random(n) < drawn["speed_unknown"], np.nan, speed)
    y = drawn["rings"] * rng.normal(size=n).cumsum()
    return stream(rudder, aileron=aileron, airspeed=airspeed, y=y, **options)


def built(pieces: list[dict[str, Any]]) -> SampleBlock:
    parts, k, mode, epoch, speed = [], 5000, 5.0, 0, 20.0
    for drawn in pieces:
        parts.append(piece(drawn, speed, first_k=k, mode=mode, epoch=epoch))
        k, event, by = k + drawn["n"], drawn["then"], drawn["by"]
        k += round(120 * by) if event == "gap" else 0
        k = round((k - 2) * by) if event == "reboot" else k
        mode = {"mode": 5.0, "no mode": np.nan, "bare": MANUAL}.get(event, mode)
        epoch += event == "epoch"
        speed *= 0.8 + 0.5 * by if event == "speed" else 1.0
    return joined(*parts)


@given(
    pieces=PIECES,
    edges=st.lists(st.integers(0, 3500), max_size=30)
    | st.sampled_from([100, 7, 1]).map(lambda every: list(range(0, 3500, every))),
)
def test_where_the_stream_is_cut_into_blocks_changes_nothing(
    pieces: list[dict[str, Any]], edges: list[int]
):
    samples = built(pieces)
    assert_same(found_in(samples, edges, bare=MANUAL), found_in(samples, bare=MANUAL))


@pytest.mark.parametrize("every", [1, 7, 100])
def test_the_mix_is_that_of_the_same_20_seconds_however_the_stream_is_cut(every: int):
    """Two of three samples are held, so that an old one more would change it"""
    aileron = weave(120.0)
    rudder = flown(rest(40), doublets(10), rest(20), doublets(10, 0.06), rest(40))
    rudder = np.where(np.arange(len(rudder)) % 3, np.nan, rudder + 0.5 * aileron)
    samples = stream(rudder, aileron=aileron)
    for until in (47 * HZ, 53 * HZ):
        strokes = []
        for edges in ([], range(30 * HZ, until, every)):
            finder = Finder(TS_S, 1.0)
            for block in cut(samples.select(slice(0, until)), edges):
                finder.feed(block)
            strokes.append(finder.progress().stroke)
        assert strokes[0] == strokes[1] > 0.0


@given(pieces=PIECES, stop=st.integers(1, 3500))
def test_each_is_a_piece_of_the_stream_as_it_came_and_depends_on_nothing_later(
    pieces: list[dict[str, Any]], stop: int
):
    """In order, once each, no row invented, none longer than 120 s, one boot, mode and epoch

    Where nothing is found there is one reason.
    """
    samples, at = built(pieces), 0
    # A column that names each row.
    samples = replace(samples, yaw=np.arange(len(samples), dtype=float))
    finder, early = (Finder(TS_S, 1.0, lambda mode: mode == MANUAL) for _ in range(2))
    found = finder.feed(samples) + finder.finish()
    for each in found:
        rows = each.yaw.astype(int)
        assert rows[0] >= at
        np.testing.assert_array_equal(rows, np.arange(rows[0], rows[0] + len(rows)))
        at = rows[-1] + 1
        assert np.all(np.diff(each.k) >= 1)
        assert each.k[-1] - each.k[0] < 120 * HZ
        assert len(np.unique(each.epoch)) == 1
        assert len(np.unique(np.nan_to_num(each.mode, nan=-1.0))) == 1
        assert np.all(np.diff(each.k[each.held == 0]) <= 2 * HZ)
    known = early.feed(samples.select(slice(0, stop)))
    assert_same(known, found[: len(known)])
    assert len(list(excitation_reasons(finder.most_whole, finder.most_own))) == 1


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


@pytest.mark.parametrize(
    ("kind", "block_s"), [*((kind, 97) for kind in LONG), ("movement, aileron moving", 1)]
)
def test_what_is_kept_is_bounded_however_long_it_flies(kind: str, block_s: int):
    """As pickled bytes: 146 s of rows are 120 s of a manoeuvre and 26 s to compare with"""
    n = 350 * HZ
    samples, finder = LONG[kind](n, np.random.default_rng(1)), Finder(TS_S, 1.0)
    largest = 0
    for i, block in enumerate(cut(samples, range(0, n, block_s * HZ))):
        finder.feed(block)
        if block_s == 97 or i % 29 == 28:
            largest = max(largest, len(pickle.dumps(finder)))
    row = (20 + 5) * 8
    assert largest < 1.2 * row * (146 + 1) * HZ


def test_a_stretch_that_the_user_named_is_exactly_one():
    named = Finder(TS_S, 1.0, is_stated=True)
    assert named.progress() == UnderWay(0.0, 0.0)
    samples = joined(stream(usual()), stream(usual(), first_k=2000, mode=5.0, epoch=1))
    for block in cut(samples, [7, 300, 1500]):
        assert named.feed(block) == []
    progress = named.progress()
    assert (progress.from_s, progress.is_excited) == (0.0, True)
    assert progress.lasted_s == pytest.approx(2999 * TS_S)
    assert_same(named.finish(), [samples])
    assert named.finish() == []


def test_the_progress_of_a_manoeuvre_is_known_and_to_ask_for_it_changes_nothing():
    """Of whole seconds: that it has rested is known 0.3 s later."""
    finder, samples, found, seen = Finder(TS_S, 1.0), stream(usual()), [], {}
    for block in cut(samples, range(0, len(samples), HZ // 2)):
        found += finder.feed(block)
        seen[(int(block.k[-1]) + 1) / HZ] = finder.progress()
    assert spans(found) == USUAL
    from_s = samples.boot_us[BEGIN - HZ] / 1e6
    near = pytest.approx
    assert seen[19.0] == (near(0.0), near(18.0), None, 0.0, False)
    assert seen[28.0] == (near(0.4), 0.0, from_s, near(9.0, abs=0.1), True)
    assert seen[33.0][1:3] == (near(2.0), from_s)
    assert seen[41.0].from_s is None


def test_the_stroke_is_unknown_while_the_mix_is():
    finder = Finder(TS_S, 1.0)
    samples = stream(doublets(12), aileron=weave(12.0))
    finder.feed(samples.select(slice(0, 2 * HZ)))
    assert finder.progress().stroke is None
    finder.feed(samples.select(slice(2 * HZ, None)))
    assert finder.progress().stroke == pytest.approx(0.4, abs=0.05)
