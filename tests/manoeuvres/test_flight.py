"""What manoeuvres say together: random effects, kappa, who is left out, when all is refused."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from yawid.manoeuvres.answer import OTHER_ORDERS, Answered, Structure
from yawid.manoeuvres.flight import TAU_WN_SHARE, TAU_ZETA, flight_of, pooled
from yawid.results.reasons import Reason, Verdict
from yawid.results.run_summary import (
    DutchRoll,
    Fit,
    Flight,
    Manoeuvre,
    MethodSummary,
    Orders,
)
from yawid.results.summary import as_summary

OWN = (3, 3, 2, 1)


def answered(
    n: int,
    wn: float,
    zeta: float = 0.3,
    *,
    wn_std: float = 0.05,
    zeta_std: float = 0.01,
    speed: float | None = 20.0,
    source: str | None = "airspeed",
    loop: str = "airframe",
    gain: tuple[float, float] = (math.nan, math.nan),
    reasons: Sequence[str] = (),
    held_back: tuple[float, float] = (math.nan, math.nan),
    other: tuple[float, float] | None = None,
    altitude: float | None = 100.0,
) -> Answered:
    """A manoeuvre with its answer; ``other`` is (wn, zeta) of the other structure"""
    verdict = Verdict.of([Reason(reason, f"about {reason}") for reason in reasons], "rml")
    roll = (wn, wn_std, zeta, zeta_std)
    told = MethodSummary(
        method="rml",
        orders=Orders(*OWN),
        sample_time_s=0.05,
        updates=500,
        held=0,
        theta={},
        theta_std={},
        dutch_roll=DutchRoll.of(roll),
        fit=Fit(),
    )
    found = Manoeuvre(
        n=n,
        from_s=100.0 * n,
        to_s=100.0 * n + 30.0,
        duration_s=30.0,
        date=f"2026-11-22T07:0{n % 10}:00.000Z",
        mode="MANUAL",
        loop=loop,
        airspeed_m_s=speed,
        airspeed_std_m_s=None if speed is None else 0.1,
        airspeed_source=source,
        altitude_m=altitude,
        inputs=["rudder"],
        orders=Orders(*OWN),
        turn_removed=False,
        estimates={"rml": told},
        verdict=as_summary(verdict),
    )
    structures = {OWN: Structure(np.array(roll), gain, held_back[0])}
    if other is not None:
        second = np.array([other[0], wn_std, other[1], zeta_std])
        structures[OTHER_ORDERS] = Structure(second, gain, held_back[1])
    return Answered(found, verdict, (n, n + 1), structures)


def together(*manoeuvres: Answered, log: Sequence[Reason] = ()) -> Flight:
    found = flight_of(manoeuvres, list(log))
    assert found is not None
    flight, verdict = found
    assert flight.verdict == as_summary(verdict)
    return flight


def at_one_speed(*wn: float, **options: Any) -> list[Answered]:
    return [answered(n, each, **options) for n, each in enumerate(wn, start=1)]


def ids(flight: Flight) -> set[str]:
    return {reason.id for reason in flight.verdict.reasons}


# Thirteen trials of a vaccine (Colditz and others, 1994): log risk ratios and their variances, the
# example every text on random effects works out; the results below are those of DerSimonian and
# Laird's method as R's metafor prints them.
EFFECTS = np.array(
    [
        -0.8893, -1.5854, -1.3481, -1.4416, -0.2175, -0.7861, -1.6209,
        0.0120, -0.4694, -1.3713, -0.3394, 0.4459, -0.0173,
    ]
)  # fmt: skip
VARIANCES = np.array(
    [
        0.3256, 0.1946, 0.4154, 0.0200, 0.0512, 0.0069, 0.2230,
        0.0040, 0.0564, 0.0730, 0.0124, 0.5325, 0.0714,
    ]
)  # fmt: skip


def test_the_pooled_numbers_are_those_of_a_published_example():
    found = pooled(EFFECTS, np.sqrt(VARIANCES), floor=0.0)

    assert found.tau**2 == pytest.approx(0.3088, abs=3e-3)
    assert found.mean == pytest.approx(-0.7141, abs=1e-3)
    assert found.error == pytest.approx(0.1787, abs=1e-3)
    assert found.std == pytest.approx(math.sqrt(0.3088 + 0.1787**2), abs=2e-3)


@pytest.mark.parametrize("count", [2, 3, 4, 8, 20])
def test_sigma_covers_what_the_next_manoeuvre_will_say(count: int):
    """Of eight 2 sigma hold 90 % and not 95: tau is an estimate itself"""
    rng, missed = np.random.default_rng(1), []
    for _ in range(1500):
        std = rng.uniform(0.05, 0.2, count)
        x = rng.normal(10.0, 0.2, count) + std * rng.normal(size=count)
        found = pooled(x, std, floor=TAU_WN_SHARE * 10.0)
        missed.append(abs(rng.normal(10.0, 0.2) - found.mean) / found.std)
    assert 0.58 < np.mean(np.array(missed) < 1.0) < 0.75
    assert 0.84 < np.mean(np.array(missed) < 2.0) < 0.97


def test_what_scatters_no_more_than_its_sigmas_has_no_scatter_between():
    found = pooled(np.array([1.0, 1.01, 0.99, 1.0]), np.full(4, 0.1), floor=0.0)
    assert (found.tau, found.error) == (0.0, pytest.approx(0.05))


@pytest.mark.parametrize(("count", "share"), [(1, 1.0), (2, 1.0), (3, 1.0), (4, 1.0), (13, 0.5)])
def test_few_do_not_tell_how_much_they_scatter(count: int, share: float):
    flight = together(*at_one_speed(*[10.0] * count))

    floor = (share * TAU_WN_SHARE * 10.0, share * TAU_ZETA)
    between = flight.between_std
    assert (between.wn_rad_s, between.zeta) == pytest.approx(floor)
    wn_std = math.hypot(floor[0], math.hypot(0.05, floor[0]) / math.sqrt(count))
    assert flight.dutch_roll.wn_std == pytest.approx(wn_std)
    zeta_std = math.hypot(floor[1], math.hypot(0.01, floor[1]) / math.sqrt(count))
    assert flight.dutch_roll.zeta_std == pytest.approx(zeta_std)


def test_manoeuvres_at_one_speed_are_told_by_their_pooled_mean():
    x, std = (10.1, 9.8, 10.3, 9.9, 10.0), (0.05, 0.08, 0.05, 0.1, 0.03)
    manoeuvres = [
        answered(n, wn, wn_std=each) for n, (wn, each) in enumerate(zip(x, std, strict=True), 1)
    ]
    flight, expected = together(*manoeuvres), pooled(np.array(x), np.array(std), 0.0)

    assert flight.dutch_roll.wn_rad_s == pytest.approx(expected.mean)
    assert flight.dutch_roll.wn_std == pytest.approx(expected.std)
    assert flight.used == [1, 2, 3, 4, 5]
    assert flight.disagree == []
    assert flight.verdict.usable
    assert (flight.method, str(flight.orders)) == ("rml", "3,3,2,1")
    assert flight.date == "2026-11-22T07:01:00.000Z"


def test_over_speeds_wn_is_proportional_and_told_at_the_median():
    """wn = kappa V, zeta the same, K proportional to V"""
    speeds = (15.0, 20.0, 28.0)
    manoeuvres = [
        answered(n, 0.4 * v, speed=v, gain=(0.02 * v, 0.001), altitude=100.0 * n)
        for n, v in enumerate(speeds, start=1)
    ]
    flight = together(*manoeuvres)

    assert flight.kappa_rad_m.value == pytest.approx(0.4)
    assert flight.airspeed_m_s == 20.0
    assert flight.altitude_m == 200.0
    assert flight.dutch_roll.wn_rad_s == pytest.approx(8.0)
    assert flight.dutch_roll.wn_std == pytest.approx(20.0 * flight.kappa_rad_m.std)
    assert flight.K_per_V.value == pytest.approx(0.02)
    assert flight.between_std.wn_rad_s == pytest.approx(TAU_WN_SHARE * 8.0)


def test_sigma_of_kappa_is_the_scatter_of_wn_over_speed():
    rng, speeds = np.random.default_rng(2), np.linspace(15.0, 30.0, 8)
    wn = 0.4 * speeds * (1.0 + 0.03 * rng.normal(size=8))
    manoeuvres = [
        answered(n, w, wn_std=0.01, speed=v)
        for n, (w, v) in enumerate(zip(wn, speeds, strict=True))
    ]
    flight = together(*manoeuvres)

    expected = pooled(wn / speeds, 0.01 / speeds, 0.0)
    assert flight.kappa_rad_m.value == pytest.approx(expected.mean)
    assert flight.kappa_rad_m.std == pytest.approx(expected.std)


@pytest.mark.parametrize("source", ["ground speed", None])
def test_without_an_airspeed_there_is_no_kappa(source: str | None):
    speed = None if source is None else 20.0
    flight = together(*at_one_speed(10.0, 10.1, source=source, speed=speed))

    assert flight.kappa_rad_m is None
    assert flight.K_per_V is None
    assert flight.airspeed_source == source
    assert flight.airspeed_m_s == speed
    assert flight.dutch_roll.wn_rad_s == pytest.approx(10.05, abs=0.01)


def test_one_manoeuvre_by_ground_speed_among_others_takes_kappa_from_all():
    manoeuvres = at_one_speed(10.0, 10.1)
    flight = together(*manoeuvres, answered(3, 10.0, source="ground speed"))

    assert flight.kappa_rad_m is None
    assert flight.airspeed_source is None
    assert flight.used == [1, 2, 3]


def test_one_bent_of_four_is_named_and_left_out_with_a_warning():
    flight = together(*at_one_speed(10.0, 10.1, 12.5, 9.9))

    assert flight.used == [1, 2, 4]
    assert flight.disagree == [3]
    assert flight.verdict.usable
    (reason,) = flight.verdict.reasons
    assert (reason.id, reason.weight) == ("manoeuvres_disagree", "warning")
    assert "manoeuvre 3 says wn 12.5 rad/s at 20.0 m/s" in reason.text
    assert flight.dutch_roll.wn_rad_s == pytest.approx(10.0, abs=0.05)


@pytest.mark.parametrize("other", [12.5, 15.0, 25.0, 7.0])
def test_two_that_disagree_are_named_and_the_flight_is_refused(other: float):
    """However far apart they are: the larger one weighs no less"""
    flight = together(*at_one_speed(10.0, other))

    assert not flight.verdict.usable
    (reason,) = flight.verdict.reasons
    assert (reason.id, reason.weight) == ("manoeuvres_disagree", "fatal")
    assert "manoeuvre 2" in reason.text or "manoeuvre 1" in reason.text
    assert len(flight.disagree) == 1


@pytest.mark.parametrize(("bent", "usable"), [(1, True), (2, True), (3, False)])
def test_less_than_two_thirds_of_the_weight_is_too_little(bent: int, usable: bool):
    """Of seven alike two are two sevenths: less than a third; three are more"""
    flight = together(*at_one_speed(*[10.0] * (7 - bent), *[13.0] * bent))

    assert flight.verdict.usable == usable
    assert len(flight.disagree) == bent


def test_a_manoeuvre_that_is_uncertain_weighs_little():
    """Two of three disagree, but are known to little more than what they differ by"""
    sure = answered(1, 10.0, wn_std=0.02)
    unsure = [answered(n, 12.5, wn_std=0.75) for n in (2, 3)]
    flight = together(sure, *unsure)

    assert flight.dutch_roll.wn_rad_s == pytest.approx(10.0, rel=0.02)
    assert flight.verdict.usable


@pytest.mark.parametrize(
    ("wn", "wn_std", "is_apart"),
    [
        (10.9, 0.01, False),  # within 10 %
        (11.2, 0.01, True),
        (11.5, 0.6, False),  # beyond 10 %, within three sigmas
        (13.0, 0.6, True),
    ],
)
def test_they_disagree_by_ten_percent_and_three_sigmas(wn: float, wn_std: float, is_apart: bool):
    flight = together(*at_one_speed(10.0, 10.0, 10.0), answered(4, wn, wn_std=wn_std))
    assert flight.disagree == ([4] if is_apart else [])


def test_disagreement_is_counted_over_speed():
    """10 rad/s at 20 m/s and 15 at 30 are the same aircraft; 15 at 20 is not"""
    alike = together(answered(1, 10.0), answered(2, 15.0, speed=30.0))
    assert alike.disagree == []
    assert not together(answered(1, 10.0), answered(2, 15.0)).verdict.usable


def test_roll_loops_are_not_mixed():
    """The one with more manoeuvres is told; where they are as many, the airframe's"""
    bare, closed = (
        answered(1, 10.0),
        [answered(n, 13.0, 0.6, loop="with_roll_loop") for n in (2, 3)],
    )
    flight = together(bare, *closed)
    assert (flight.loop, flight.used, flight.disagree) == ("with_roll_loop", [2, 3], [])
    assert flight.dutch_roll.level is None
    even = together(closed[0], bare)
    assert (even.loop, even.used) == ("airframe", [1])
    assert even.dutch_roll.level is not None


def test_a_manoeuvre_that_may_not_be_used_is_not():
    flight = together(answered(1, 10.0), answered(2, 10.1, reasons=["poor_fit"]))
    assert flight.used == [1]
    assert flight.disagree == []
    assert flight.verdict.usable


def test_the_flight_bears_what_most_of_its_manoeuvres_are_warned_of():
    """Of residuals that are not white no more is said: its sigma is not that of one fit"""
    for count, is_borne in ((2, False), (3, True)):
        manoeuvres = [
            answered(n, 10.0, reasons=["closed_loop", "coloured_residuals"][: 2 * (n <= count)])
            for n in range(1, 5)
        ]
        assert ids(together(*manoeuvres)) == ({"closed_loop"} if is_borne else set())


def test_warnings_of_a_manoeuvre_make_it_no_less_usable():
    assert together(answered(1, 10.0, reasons=["coloured_residuals"])).used == [1]


def test_a_flight_without_a_usable_manoeuvre_bears_the_reasons_of_the_best():
    worst = answered(1, 10.0, reasons=["not_excited", "poor_fit"])
    best = answered(2, 10.0, reasons=["poor_fit", "coloured_residuals"])
    bad = answered(3, 10.0, reasons=["not_converged"])
    flight = together(worst, best, bad)

    assert not flight.verdict.usable
    assert ids(flight) == {"poor_fit", "coloured_residuals"}
    text = next(each.text for each in flight.verdict.reasons if each.id == "poor_fit")
    assert text == "manoeuvre 2, 200 to 230 s: about poor_fit"
    assert flight.dutch_roll is None
    assert (flight.used, flight.disagree) == ([], [])


def test_what_speaks_against_the_log_speaks_against_the_flight():
    for id_, usable in (("rudder_assumed", True), ("not_in_command", False)):
        flight = together(answered(1, 10.0), log=[Reason(id_, "of the log")])
        assert ids(flight) == {id_}
        assert flight.verdict.usable == usable


def test_no_manoeuvre_is_no_flight():
    assert flight_of([], [Reason("rudder_assumed", "of the log")]) is None


@pytest.mark.parametrize(
    ("gains", "orders"),
    [((2.0, 2.0), OTHER_ORDERS), ((3.0, 0.0), OTHER_ORDERS), ((0.9, 0.9), OWN), ((5.0, -6.0), OWN)],
)
def test_more_parameters_tell_the_flight_where_held_back_data_say_so_on_the_mean(
    gains: tuple[float, float], orders: tuple[int, int, int, int]
):
    manoeuvres = [
        answered(n, 10.0, held_back=(70.0, 70.0 + gain), other=(10.5, 0.35))
        for n, gain in enumerate(gains, start=1)
    ]
    flight = together(*manoeuvres)

    assert str(flight.orders) == ",".join(map(str, orders))
    wn, zeta = (10.5, 0.35) if orders == OTHER_ORDERS else (10.0, 0.3)
    assert flight.dutch_roll.wn_rad_s == pytest.approx(wn)
    assert flight.dutch_roll.zeta == pytest.approx(zeta)


def test_more_parameters_that_one_manoeuvre_cannot_tell_tell_none():
    known = answered(1, 10.0, held_back=(70.0, 80.0), other=(10.5, 0.35))
    for rest in (
        answered(2, 10.0),
        answered(2, 10.0, held_back=(70.0, 80.0), other=(math.nan, 0.3)),
        answered(2, 10.0, held_back=(70.0, 80.0), other=(48.0, 0.3)),  # another mode
    ):
        assert str(together(known, rest).orders) == "3,3,2,1"
    nothing_held_back = at_one_speed(10.0, 10.0, other=(10.5, 0.35))
    assert str(together(*nothing_held_back).orders) == "3,3,2,1"


def test_gains_that_no_manoeuvre_knows_are_not_told():
    flight = together(answered(1, 10.0), answered(2, 10.0, gain=(0.4, 0.01)))
    assert flight.K_per_V.value == pytest.approx(0.02)
    assert together(answered(1, 10.0)).K_per_V is None


NUMBERS = st.floats(0.1, 50.0)


@settings(deadline=None)
@given(
    st.lists(
        st.tuples(NUMBERS, st.floats(1e-4, 5.0), st.floats(5.0, 60.0)), min_size=1, max_size=8
    ),
    st.randoms(),
)
def test_the_order_of_manoeuvres_and_their_units_do_not_matter(rows, random):
    manoeuvres = [
        answered(n, wn, wn_std=std, speed=v) for n, (wn, std, v) in enumerate(rows, start=1)
    ]
    mixed = list(manoeuvres)
    random.shuffle(mixed)
    one, other = together(*manoeuvres), together(*mixed)

    assert sorted(one.used + one.disagree) == list(range(1, len(rows) + 1))
    assert len(one.used) > 0
    low, high = min(r[0] / r[2] for r in rows), max(r[0] / r[2] for r in rows)
    assert low * (1 - 1e-9) <= one.kappa_rad_m.value <= high * (1 + 1e-9)
    assert one.kappa_rad_m.std > 0.0
    if sorted(one.used) == sorted(other.used):
        assert one.kappa_rad_m.value == pytest.approx(other.kappa_rad_m.value)
        assert one.dutch_roll.wn_std == pytest.approx(other.dutch_roll.wn_std)
        assert one.verdict.usable == other.verdict.usable
