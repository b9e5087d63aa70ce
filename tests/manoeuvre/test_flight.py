"""What manoeuvres say together: random effects, kappa, who is left out, when all is refused."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pytest
from hand_flights import by_ct, manoeuvre
from hypothesis import given
from hypothesis import strategies as st
from msgspec import structs

from yawid.answers.reasons import Reason, Verdict
from yawid.answers.run_summary import DutchRoll, Flight, Manoeuvre, Value
from yawid.blocks import Floats
from yawid.manoeuvre.conditions import Finding
from yawid.manoeuvre.flight import POWERS, TAU_WN_SHARE, TAU_ZETA, Pooled, flights_of, pooled


def by_noise(x: Floats, std: Floats, floor: float) -> Pooled:
    """The pooled mean where the structure leaves nothing out"""
    return pooled(x, std, floor, np.zeros_like(x))


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
    found = by_noise(EFFECTS, np.sqrt(VARIANCES), floor=0.0)

    std = math.sqrt(0.3088 + 0.1787**2)
    numbers = (found.tau**2, found.mean, found.error, found.std)
    assert numbers == pytest.approx((0.3088, -0.7141, 0.1787, std), abs=2e-3)


@pytest.mark.parametrize("count", [2, 3, 4, 8, 20])
def test_sigma_covers_what_the_next_manoeuvre_will_say(count: int):
    """Of eight 2 sigma hold 90 % and not 95: tau is an estimate itself"""
    rng, missed = np.random.default_rng(1), []
    for _ in range(1500):
        std = rng.uniform(0.05, 0.2, count)
        x = rng.normal(10.0, 0.2, count) + std * rng.normal(size=count)
        found = by_noise(x, std, floor=TAU_WN_SHARE * 10.0)
        missed.append(abs(rng.normal(10.0, 0.2) - found.mean) / found.std)
    assert 0.58 < np.mean(np.array(missed) < 1.0) < 0.75
    assert 0.84 < np.mean(np.array(missed) < 2.0) < 0.97


def test_a_manoeuvre_without_noise_does_not_hide_how_far_the_others_scatter():
    """What scatters no more than its sigmas has no scatter between."""
    alike = by_noise(np.array([1.0, 1.01, 0.99, 1.0]), np.full(4, 0.1), floor=0.0)
    found = by_noise(np.array([10.0, 10.5, 9.5]), np.array([0.0, 0.1, 0.1]), floor=0.0)

    assert (alike.tau, alike.error) == (0.0, pytest.approx(0.05))
    assert math.isfinite(found.mean)
    assert found.tau > 0.3


@given(
    rows=st.lists(
        st.tuples(st.floats(5.0, 15.0), st.floats(0.01, 1.0), st.floats(0.0, 1.0)),
        min_size=1,
        max_size=8,
    ),
    floor=st.floats(0.0, 0.5),
)
def test_what_noise_does_not_explain_is_in_common_and_weighs_nothing(rows, floor: float):
    """Its root mean square comes on top of the two others; mean, error and tau are without it"""
    x, std, beyond = np.array(rows).T
    found, without = pooled(x, std, floor, beyond), by_noise(x, std, floor)

    assert (found.mean, found.error, found.tau) == (without.mean, without.error, without.tau)
    common = math.sqrt(np.mean(beyond**2))
    assert found.std == pytest.approx(math.sqrt(found.error**2 + found.tau**2 + common**2))
    assert found.noise == pytest.approx(1.0 / math.sqrt(np.sum(std**-2.0)))
    assert found.noise <= found.error * (1.0 + 1e-12)


SWING = {
    "settling_s": math.hypot(TAU_WN_SHARE, TAU_ZETA / 0.3),
    "overshoot_pct": TAU_ZETA * math.pi / (1.0 - 0.3**2) ** 1.5,
}
"""The least scatter of what is no number of eq. 22-23, at a zeta of 0.3."""


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
    gain: tuple[float, float] | None = None,
    reasons: Sequence[str] = (),
    altitude: float | None = 100.0,
    beyond: tuple[float, float] = (0.0, 0.0),
    physics: Mapping[str, tuple[float, float]] | None = None,
) -> Manoeuvre:
    """A manoeuvre with its answer; ``beyond`` are the sigmas of wn and zeta beyond noise."""
    numbers = physics or ({} if gain is None else {"K": gain})
    verdict = Verdict.of([Reason(reason, f"about {reason}") for reason in reasons], "ct")
    noise = (wn_std, zeta_std)
    std = [math.hypot(*each) for each in zip(noise, beyond, strict=True)]
    roll = DutchRoll.of((wn, std[0], zeta, std[1]), noise)
    values = {name: Value(*each) for name, each in numbers.items()}
    swing = {name: values.pop(name) for name in SWING if name in values}
    return manoeuvre(
        n,
        speed=speed,
        from_s=100.0 * n,
        to_s=100.0 * n + 30.0,
        duration_s=30.0,
        date=f"2026-11-22T07:0{n % 10}:00.000Z",
        mode="MANUAL",
        loop=loop,
        airspeed_source=source,
        altitude_m=altitude,
        estimates={"ct": structs.replace(by_ct(roll), physics=values, **swing)},
        verdict=verdict,
    )


def together(*manoeuvres: Manoeuvre, log: Sequence[Reason] = ()) -> Flight:
    [flight] = flights_of(manoeuvres, list(log))
    return flight


def at_one_speed(*wn: float, **options: Any) -> list[Manoeuvre]:
    return [answered(n, each, **options) for n, each in enumerate(wn, start=1)]


@pytest.mark.parametrize("count", [1, 4, 16])
def test_what_the_structure_leaves_out_does_not_shrink_with_the_count(count: int):
    """wn 10 at 20 m/s: .2 of wn, .03 of zeta and a part of K's stay, however many agree"""
    manoeuvres = at_one_speed(*[10.0] * count, beyond=(0.2, 0.03), gain=(0.4, 0.008))
    flight, without = (together(*each) for each in (manoeuvres, at_one_speed(*[10.0] * count)))

    found, bare = flight.dutch_roll, without.dutch_roll
    for name, own in (("wn_std", 0.2), ("wn_std_mean", 0.2), ("zeta_std", 0.03),
                      ("zeta_std_mean", 0.03)):  # fmt: skip
        assert getattr(found, name) == pytest.approx(math.hypot(getattr(bare, name), own))
    assert flight.kappa_rad_m.std == pytest.approx(found.wn_std / 20.0)
    assert flight.K_per_V.std > math.sqrt(0.5) * 0.008 / 20.0  # half of its variance
    for each in (flight, without):
        assert each.dutch_roll.wn_std_noise == pytest.approx(0.05 / math.sqrt(count))
        assert each.dutch_roll.zeta_std_noise == pytest.approx(0.01 / math.sqrt(count))
        assert each.kappa_rad_m.std_noise == pytest.approx(0.05 / 20.0 / math.sqrt(count))


@pytest.mark.parametrize(("count", "share"), [(1, 1.0), (2, 1.0), (3, 1.0), (4, 1.0), (13, 0.5)])
def test_few_do_not_show_how_much_they_scatter(count: int, share: float):
    flight = together(*at_one_speed(*[10.0] * count))

    floor = (share * TAU_WN_SHARE * 10.0, share * TAU_ZETA)
    between = flight.between_std
    assert (between.wn_rad_s, between.zeta) == pytest.approx(floor)
    wn_std = math.hypot(floor[0], math.hypot(0.05, floor[0]) / math.sqrt(count))
    assert flight.dutch_roll.wn_std == pytest.approx(wn_std)
    zeta_std = math.hypot(floor[1], math.hypot(0.01, floor[1]) / math.sqrt(count))
    assert flight.dutch_roll.zeta_std == pytest.approx(zeta_std)


@pytest.mark.parametrize("speeds", [(20.0,) * 5, (15.0, 18.0, 20.0, 25.0, 30.0)])
def test_manoeuvres_at_one_speed_have_their_pooled_mean(speeds: tuple[float, ...]):
    """And of several speeds kappa has, that of wn over the speed"""
    wn = np.array([10.1, 9.8, 10.3, 9.9, 10.0]) / 20.0 * speeds
    std = np.array([0.05, 0.08, 0.05, 0.1, 0.03])
    rows = zip(wn, std, speeds, strict=True)
    manoeuvres = [answered(n, w, wn_std=s, speed=v) for n, (w, s, v) in enumerate(rows, start=1)]
    flight, found = together(*manoeuvres), by_noise(wn / speeds, std / speeds, floor=0.0)

    assert found.tau > TAU_WN_SHARE * 0.5, "the example must scatter beyond the floor"
    kappa = flight.kappa_rad_m
    assert (kappa.value, kappa.std) == pytest.approx((found.mean, found.std))
    assert flight.dutch_roll.wn_rad_s == pytest.approx(20.0 * found.mean)
    assert flight.dutch_roll.wn_std == pytest.approx(20.0 * found.std)
    assert (flight.used, flight.disagree) == ([1, 2, 3, 4, 5], [])
    assert (flight.verdict.usable, flight.method) == (True, "ct")
    assert flight.date == "2026-11-22T07:01:00.000Z"
    assert (flight.K_per_V, flight.physics) == (None, None)  # no manoeuvre knows them
    one_knows = together(*manoeuvres, answered(6, 10.0, gain=(0.4, 0.01)))
    assert one_knows.K_per_V.value == pytest.approx(0.02)


def test_over_speeds_wn_is_proportional_and_given_at_the_median():
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


@pytest.mark.parametrize(
    ("sources", "source"),
    [(["ground speed"] * 3, "ground speed"), ([None] * 3, None),
     (["airspeed", "airspeed", "ground speed"], None)],
)  # fmt: skip
def test_without_an_airspeed_of_each_there_is_no_kappa(
    sources: list[str | None], source: str | None
):
    physics = {"a_my_beta": (90.0, 1.0)}, {"a_my_beta": (110.0, 1.0)}, {"a_my_beta": (100.0, 1.0)}
    flight = together(
        *(
            answered(n, 10.0, source=each, speed=None if each is None else 20.0, physics=known)
            for n, (each, known) in enumerate(zip(sources, physics, strict=True), start=1)
        )
    )

    assert (flight.kappa_rad_m, flight.K_per_V) == (None, None)
    assert (flight.airspeed_source, flight.used) == (source, [1, 2, 3])
    assert flight.dutch_roll.wn_rad_s == pytest.approx(10.0)
    assert flight.physics["a_my_beta"].value == pytest.approx(100.0)
    assert flight.physics["a_my_beta"].std > 10.0  # they differ by twenty


ALIKE = at_one_speed(10.0, 10.0, 10.0)
SOME: dict[str, tuple[list[Manoeuvre], list[int], bool]] = {
    # However far apart they are: the larger one weighs no less.
    **{
        f"two, of 10 and {other}": (at_one_speed(10.0, other), [named], False)
        for other, named in ((12.5, 2), (15.0, 2), (25.0, 2), (7.0, 1))
    },
    "one bent of four": (at_one_speed(10.0, 10.1, 12.5, 9.9), [3], True),
    # Of seven alike two are two sevenths: less than a third; three are more.
    "one bent of seven": (at_one_speed(*[10.0] * 6, 13.0), [7], True),
    "two bent of seven": (at_one_speed(*[10.0] * 5, *[13.0] * 2), [6, 7], True),
    "three bent of seven": (at_one_speed(*[10.0] * 4, *[13.0] * 3), [5, 6, 7], False),
    "two of three, known to little more than what they differ by": (
        [answered(1, 10.0, wn_std=0.02), *(answered(n, 12.5, wn_std=0.75) for n in (2, 3))],
        [2, 3], True,
    ),
    "within 10 %": ([*ALIKE, answered(4, 10.9, wn_std=0.01)], [], True),
    "beyond 10 %": ([*ALIKE, answered(4, 11.2, wn_std=0.01)], [4], True),
    "beyond 10 %, within three sigmas": ([*ALIKE, answered(4, 11.5, wn_std=0.6)], [], True),
    "beyond both": ([*ALIKE, answered(4, 13.0, wn_std=0.6)], [4], True),
    "10 rad/s at 20 m/s and 15 at 30": (
        [answered(1, 10.0), answered(2, 15.0, speed=30.0)], [], True,
    ),
    "one that may not be used": (
        [answered(1, 10.0), answered(2, 12.5, reasons=["poor_fit"])], [], True,
    ),
    "one that is warned of": ([answered(1, 10.0, reasons=["saturated"])], [], True),
}  # fmt: skip
"""Manoeuvres, those that disagree, and whether their flight is usable."""


@pytest.mark.parametrize("name", SOME)
def test_those_that_disagree_are_left_out_with_a_warning_unless_too_little_is_left(name: str):
    """They differ by 10 % and three sigmas, over speed, and leave two thirds of the weight"""
    manoeuvres, apart, usable = SOME[name]
    flight = together(*manoeuvres)

    good = [each.n for each in manoeuvres if each.verdict.usable]
    assert (flight.disagree, flight.verdict.usable) == (apart, usable)
    assert not usable or flight.used == [n for n in good if n not in apart]
    said = {each.id: each for each in flight.verdict.reasons}
    assert ("manoeuvres_disagree" in said) == bool(apart)
    if usable:
        assert 20.0 * flight.kappa_rad_m.value == pytest.approx(10.0, rel=0.025)
    if apart:
        assert said["manoeuvres_disagree"].weight == ("warning" if usable else "fatal")
    if usable and apart:
        bent = manoeuvres[apart[0] - 1]
        text = f"manoeuvre {bent.n} has wn {bent.dutch_roll.wn_rad_s:.3g} rad/s at 20.0 m/s"
        assert text in said["manoeuvres_disagree"].text


LOOPS = {"a": "airframe", "r": "with_roll_loop", "u": "unknown"}


@pytest.mark.parametrize(
    ("flown", "first"),
    [("arr", "r"), ("raa", "a"), ("ar", "a"), ("uurr", "u"), ("uurrr", "r"), ("aR", "r"),
     ("AArrr", "r")],
)  # fmt: skip
def test_each_loop_has_an_answer_and_that_of_most_manoeuvres_is_the_headline(
    flown: str, first: str
):
    """However sure each is; of as many manoeuvres the longer ones, then what was flown first

    A capital is a manoeuvre of a minute instead of half of one.
    """
    wn_std = {"a": 0.05, "r": 0.3, "u": 0.5}
    manoeuvres = [
        structs.replace(
            answered(n, 10.0, wn_std=wn_std[each.lower()], loop=LOOPS[each.lower()]),
            duration_s=60.0 if each.isupper() else 30.0,
        )
        for n, each in enumerate(flown, start=1)
    ]
    found = flights_of(manoeuvres, [])

    assert found[0].loop == LOOPS[first]
    assert {each.loop: each.used for each in found} == {
        LOOPS[each]: [n for n, loop in enumerate(flown.lower(), start=1) if loop == each]
        for each in dict.fromkeys(flown.lower())
    }
    for each in found:
        assert each.verdict.usable
        assert (each.dutch_roll.level is not None) == (each.loop == "airframe")
        alone = [m for m in manoeuvres if m.loop == each.loop]
        assert each == together(*alone)


def test_numbers_are_pooled_over_the_power_of_the_airspeed_with_which_they_go():
    """Of an aircraft at constant density: K = 0.02 V, T = 20 / V, N_beta = 0.16 V^2 and so on; the
    swing after a step scatters as zeta does, which is 0.3, by 0.02"""
    law = {
        "K": lambda v: 0.02 * v, "T_theta_s": lambda v: 20.0 / v, "a_z_beta": lambda v: v / 20.0,
        "a_my_omega_y": lambda v: 0.1 * v, "a_my_beta": lambda v: 0.16 * v * v,
        "a_my_delta_h": lambda v: 0.02 * 0.16 * v * v,
        "settling_s": lambda v: 25.0 / v, "overshoot_pct": lambda v: 37.0,
    }  # fmt: skip
    manoeuvres = [
        answered(
            n, 0.4 * v, speed=v,
            physics={name: (of(v), 0.02 * of(v)) for name, of in law.items()},
        )
        for n, v in enumerate((15.0, 20.0, 28.0), start=1)
    ]  # fmt: skip
    flight = together(*manoeuvres)

    assert flight.physics.keys() == POWERS.keys() == law.keys() - SWING.keys()
    for name, of in law.items():
        found = getattr(flight, name) if name in SWING else flight.physics[name]
        assert found.value == pytest.approx(of(20.0)), name
        tau = TAU_WN_SHARE * (2 if "_my_" in name and "omega" not in name else 1)
        tau = SWING.get(name, tau)
        half = math.sqrt(0.5) * 0.02  # as much of the variance is common to all
        std = math.hypot(tau, math.hypot(half, tau) / math.sqrt(3.0), half)
        assert found.std == pytest.approx(std * of(20.0))
    assert flight.K_per_V.value == pytest.approx(0.02)


def test_the_flight_has_what_most_of_its_manoeuvres_are_warned_of():
    """Of each warning by itself: three of four are most, two are not"""
    warned = [
        ["closed_loop", "saturated"],
        ["saturated", "closed_loop"],
        ["saturated"],
        [],
    ]
    flight = together(*(answered(n, 10.0, reasons=each) for n, each in enumerate(warned, 1)))

    (reason,) = flight.verdict.reasons
    assert (reason.id, reason.weight) == ("saturated", "warning")
    assert reason.text == "in 3 of 4 manoeuvres: about saturated"


def test_how_well_wn_is_known_is_said_of_the_flights_own_sigma():
    """Four values of 8 % have a mean of about 4 %; a single one stays a rough value"""
    rough = [answered(n, 10.0, wn_std=0.8, reasons=["poorly_known"]) for n in (1, 2, 3, 4)]

    (reason,) = together(rough[0]).verdict.reasons
    assert (reason.id, reason.weight) == ("poorly_known", "warning")
    assert "wn is only known to 8 %" in reason.text
    assert together(*rough).verdict.reasons == []


def test_a_flight_without_a_usable_manoeuvre_has_the_reasons_of_the_best_of_several_the_longest():
    worst = answered(1, 10.0, reasons=["not_excited", "poor_fit"])
    best = answered(2, 10.0, reasons=["poor_fit", "saturated"])
    short = structs.replace(answered(3, 10.0, reasons=["not_converged"]), duration_s=29.0)
    for each in ([worst, best, short], [short, best, worst]):
        flight = together(*each)

        assert not flight.verdict.usable
        said = {reason.id: reason.text for reason in flight.verdict.reasons}
        assert said.keys() == {"poor_fit", "saturated"}
        assert said["poor_fit"] == "manoeuvre 2, 200 to 230 s: about poor_fit"
        assert (flight.dutch_roll, flight.used, flight.disagree) == (None, [], [])


def test_what_speaks_against_the_log_speaks_against_the_flight():
    for id_, usable in (("rudder_assumed", True), ("not_in_command", False)):
        log = [Reason(id_, "of the log")]
        flight = together(answered(1, 10.0), log=log)
        assert {reason.id for reason in flight.verdict.reasons} == {id_}
        assert flight.verdict.usable == usable
        assert flights_of([], log) == []


NUMBERS = st.floats(0.1, 50.0)


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


def test_of_an_airspeed_that_cannot_be_true_nothing_is_used_but_how_manoeuvres_compare() -> None:
    """wn 3, 4, 5 at 15, 20, 25 m/s as reported: kappa .2 of what is reported, and of nothing."""
    three = [
        answered(n, 0.2 * v, speed=v, gain=(0.4, 0.01))
        for n, v in enumerate((15.0, 20.0, 25.0), start=1)
    ]
    by_factor = Finding(Reason("airspeed_implausible", "2 times"), is_factor=True)
    blocked = Finding(Reason("airspeed_implausible", "no wind is as fast"), is_factor=False)

    [found] = flights_of(three, [], by_factor)
    assert (found.used, found.disagree) == ([1, 2, 3], [])
    assert found.dutch_roll.wn_rad_s == pytest.approx(4.0, rel=1e-6)  # that at the median
    assert found.dutch_roll.wn_std < 0.2
    assert (found.kappa_rad_m, found.K_per_V, found.airspeed_m_s) == (None, None, None)
    assert [reason.id for reason in found.verdict.reasons] == ["airspeed_implausible"]

    [found] = flights_of(three, [], blocked)
    said = {reason.id: reason.text for reason in found.verdict.reasons}
    assert "m/s" not in said["manoeuvres_disagree"]
