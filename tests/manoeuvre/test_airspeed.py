"""An airspeed that cannot be true is warned of, and a right one in wind never is.

Truth is made here: a heading, an airspeed, a wind, and the ground speed as their sum.
"""

from __future__ import annotations

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from manoeuvre.streams import HZ, cut, stream

from yawid.blocks import Floats, Held, SampleBlock
from yawid.manoeuvre.conditions import AirspeedCheck, Finding, conditions

ROOT_DENSITY_4000_M = 0.8179
"""Square root of .6689, the standard atmosphere's density ratio at 4000 m (ICAO's table)."""
TURN_S = 40.0


def turning(seconds: float, turn_s: float = TURN_S) -> Floats:
    """Headings of a steady turn"""
    return 2.0 * math.pi * np.arange(round(HZ * seconds)) / HZ / turn_s


def flight(
    yaw: Floats,
    *,
    true_m_s: float = 20.0,
    reported_m_s: float | Floats = 20.0,
    wind: tuple[float, float] = (0.0, 0.0),
    **more: float | Floats,
) -> SampleBlock:
    """A flight of these headings at a true airspeed through a wind (to north, to east)"""
    north, east = true_m_s * np.cos(yaw) + wind[0], true_m_s * np.sin(yaw) + wind[1]
    columns = {"ground_speed": np.hypot(north, east), "altitude": 0.0} | more
    return stream(np.zeros(len(yaw)), airspeed=reported_m_s, yaw=yaw, **columns)


def finding(samples: SampleBlock, edges: tuple[int, ...] = ()) -> Finding | None:
    check = AirspeedCheck(1.0 / HZ)
    for block in cut(samples, edges):
        check.feed(block)
    return check.finding()


@pytest.mark.parametrize("wind", [(0.0, 0.0), (8.0, -6.0), (-14.0, 0.0), (0.0, 19.0)])
@pytest.mark.parametrize("reported_m_s", [18.0, 20.0, 22.0])
def test_a_right_airspeed_in_wind_is_not_warned_of(
    wind: tuple[float, float], reported_m_s: float
) -> None:
    assert finding(flight(turning(120.0), reported_m_s=reported_m_s, wind=wind)) is None


@pytest.mark.parametrize("factor", [0.5, 0.77, 1.3, 2.0, 56.0])
@pytest.mark.parametrize("wind", [(0.0, 0.0), (8.0, -6.0)])
def test_a_factor_seen_on_several_headings_is_reported(
    factor: float, wind: tuple[float, float]
) -> None:
    found = finding(flight(turning(120.0), reported_m_s=20.0 / factor, wind=wind))

    assert found is not None
    assert found.is_factor
    assert found.reason.id == "airspeed_implausible"
    said = re.match(
        r"the ground speed on several headings implies ([\d.]+) ± [\d.]+ times the airspeed "
        r"reported, with (\d+) m/s of wind",
        found.reason.text,
    )
    assert said is not None
    assert float(said[1]) == pytest.approx(factor, rel=0.01)
    assert float(said[2]) == pytest.approx(math.hypot(*wind), abs=0.5)


def test_a_noisy_number_that_is_no_airspeed_is_none() -> None:
    rng = np.random.default_rng(4)
    blocked = rng.uniform(0.4, 1.5, round(120.0 * HZ))

    found = finding(flight(turning(120.0), reported_m_s=blocked, wind=(5.0, 5.0)))
    assert found is not None
    assert "tail wind" in found.reason.text
    assert not found.is_factor


def test_the_true_airspeed_high_up_is_what_the_ground_speed_is_held_against() -> None:
    high = {"true_m_s": 20.0 / ROOT_DENSITY_4000_M, "wind": (6.0, 3.0)}

    assert finding(flight(turning(120.0), altitude=4000.0, **high)) is None
    assert finding(flight(turning(120.0), altitude=0.0, **high)) is not None
    assert finding(flight(turning(120.0), altitude=np.nan, **high)) is None  # it may be as high


def test_on_one_heading_only_a_tail_wind_that_no_flight_has_is_implausible() -> None:
    straight = np.zeros(round(60.0 * HZ))

    found = finding(flight(straight, true_m_s=51.0, reported_m_s=0.9))
    assert found is not None
    assert not found.is_factor
    assert "51 m/s over ground at an airspeed of 0.9 m/s" in found.reason.text
    alone, untrue = conditions(flight(straight, true_m_s=51.0, reported_m_s=0.9), 1, (3, 1))
    assert untrue == found.reason
    assert (alone.airspeed_m_s, alone.airspeed_source, alone.airspeed_kind) == (None, None, None)
    # Faster than the aircraft, and still a wind; and a head wind may leave nothing.
    for wind in ((12.0, 0.0), (-10.0, 0.0), (0.0, 12.0)):
        samples = flight(straight, true_m_s=10.0, reported_m_s=10.0, wind=wind)
        assert finding(samples) is None
        right, untrue = conditions(samples, 1, (3, 1))
        assert (untrue, right.airspeed_m_s) == (None, 10.0)


@pytest.mark.parametrize(
    ("reported_m_s", "slip", "is_implausible"),
    [
        (20.0, 1.0, False),
        (20.0, 1.4, False),
        (10.0, 1.0, True),
        (8.0, 1.0, True),
        (50.0, 1.0, True),
    ],
)
def test_without_a_ground_speed_bank_and_turn_rate_say_it_coarsely(
    reported_m_s: float, slip: float, is_implausible: bool
) -> None:
    """V = g tan(bank) / turn rate; an aircraft that slips turns less than its bank asks for."""
    yaw = turning(120.0)
    bank = math.atan(20.0 * slip * 2.0 * math.pi / TURN_S / 9.80665)

    found = finding(flight(yaw, reported_m_s=reported_m_s, roll=bank, ground_speed=np.nan))

    assert (found is not None) == is_implausible
    if found is not None:
        said = re.match(r"bank and turn rate imply ([\d.]+) ± ([\d.]+) times", found.reason.text)
        assert said is not None
        assert abs(float(said[1]) - 20.0 / reported_m_s) < 2.0 * float(said[2])


def test_what_is_found_does_not_depend_on_how_the_stream_is_cut() -> None:
    rng = np.random.default_rng(1)
    n = round(90.0 * HZ)
    noisy = 15.0 + rng.standard_normal(n)
    samples = flight(turning(90.0) + 0.1 * rng.standard_normal(n), reported_m_s=noisy)
    whole = finding(samples)
    assert whole is not None

    assert finding(samples, (1, 2, 3, 19, 20, 21, 400, 1111)) == whole
    for every in (1, 7, 100):
        assert finding(samples, tuple(range(0, n, every))) == whole


def legs(seconds: float, leg_s: float) -> Floats:
    """Headings around a rectangle"""
    return 0.3 + np.arange(round(HZ * seconds)) / HZ // leg_s * 0.5 * math.pi


@pytest.mark.parametrize("leg_s", [20.0, 125.0])
def test_the_legs_of_a_rectangle_are_several_headings(leg_s: float) -> None:
    found = finding(flight(legs(590.0, leg_s), reported_m_s=25.0, wind=(8.0, -6.0)))
    assert found is not None
    assert "several headings implies 0.8 ±" in found.reason.text


def test_two_opposite_headings_cannot_separate_a_factor_from_a_wind() -> None:
    there_and_back = 2.0 * legs(590.0, 60.0)
    assert finding(flight(there_and_back, reported_m_s=25.0, wind=(8.0, -6.0))) is None


def test_each_two_minutes_of_circles_are_a_factor_of_their_own() -> None:
    """Of five with a least scatter of 5 % the mean is known to 2.2 %"""
    found = finding(flight(turning(599.0), reported_m_s=10.0))
    assert found is not None
    assert "implies 2 ± 0.045 times" in found.reason.text


def test_circles_of_which_each_has_another_factor_have_none() -> None:
    samples = [
        flight(turning(120.0), reported_m_s=20.0 / factor, first_k=round(120 * HZ * i))
        for i, factor in enumerate((1.6, 2.6, 1.3, 2.0))
    ]
    found = finding(SampleBlock.joined(samples))
    assert found is not None
    assert "several headings implies 1.8 ±" in found.reason.text
    assert not found.is_factor


def test_on_the_ground_nothing_is_checked() -> None:
    samples = flight(np.zeros(round(60.0 * HZ)), true_m_s=51.0, reported_m_s=0.9)
    assert finding(samples) is not None
    assert finding(replace(samples, on_ground=np.ones(len(samples)))) is None
    assert finding(replace(samples, held=np.full(len(samples), int(Held.HOVER)))) is None


@pytest.mark.parametrize(
    ("side", "altitude", "is_implausible"),
    [
        (1.0, 0.0, True),
        (1.0, np.nan, False),
        (-1.0, 0.0, False),
    ],
)
def test_a_turn_is_to_the_side_of_its_bank_and_may_be_high_up(
    side: float, altitude: float, is_implausible: bool
) -> None:
    """A factor of 1.5 at a sigma of 0.12, of 0.15 where it may be flown at 5000 m: 3.4, 2.7"""
    bank = side * math.atan(20.0 * 1.2 * 2.0 * math.pi / TURN_S / 9.80665)
    more = {"roll": bank, "altitude": altitude, "ground_speed": np.nan}
    found = finding(flight(turning(120.0), reported_m_s=20.0 / 1.5, **more))
    assert (found is not None) == is_implausible


def test_another_boot_is_another_stretch() -> None:
    samples = flight(turning(130.0), reported_m_s=25.0, wind=(8.0, -6.0))
    found = finding(SampleBlock.joined([samples, samples]))
    assert found is not None
    assert "several headings implies 0.8 ±" in found.reason.text


def test_the_seconds_that_it_keeps_are_bounded() -> None:
    check = AirspeedCheck(1.0 / HZ)
    samples = flight(np.zeros(HZ * 3000))
    for i in range(13):
        check.feed(replace(samples, k=samples.k + i * HZ * 3000))
    assert len(check._kept) == 36_000
