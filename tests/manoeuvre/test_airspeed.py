"""An airspeed that cannot be true is found, a right one in wind is not, and none is unknown.

Truth is made here: a heading, an airspeed, a wind, and the ground speed as their sum.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from finished_runs import replayed
from manoeuvre.streams import HZ, cut, stream
from sources.logs import dataflash_flight, ulog_flight
from sources.logs.onboard_flight import Flight, flown

import yawid
from yawid.answers.run_summary import Flight as Answer
from yawid.blocks import Floats, Held, SampleBlock
from yawid.cli.main import main
from yawid.manoeuvre.conditions import AirspeedCheck, Finding
from yawid.quantities.airspeed import known

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


def legs(seconds: float, leg_s: float) -> Floats:
    """Headings around a rectangle"""
    return 0.3 + np.arange(round(HZ * seconds)) / HZ // leg_s * 0.5 * math.pi


def banked(reported_m_s: float, slip: float, side: float = 1.0, **more: float) -> SampleBlock:
    """V = g tan(bank) / turn rate; an aircraft that slips turns less than its bank asks for."""
    bank = side * math.atan(20.0 * slip * 2.0 * math.pi / TURN_S / 9.80665)
    its: dict[str, Any] = {"roll": bank, "ground_speed": np.nan} | more
    return flight(turning(120.0), reported_m_s=reported_m_s, **its)


STRAIGHT = np.zeros(round(60.0 * HZ))
WINDY = {"reported_m_s": 25.0, "wind": (8.0, -6.0)}
HIGH = flight(turning(120.0), true_m_s=20.0 / ROOT_DENSITY_4000_M, wind=(6.0, 3.0), altitude=4000.0)
BLOCKED = flight(STRAIGHT, true_m_s=51.0, reported_m_s=0.9)
OF_HEADINGS, OF_BANK = "the ground speed on several headings implies ", "bank and turn rate imply "
BOOT = flight(turning(130.0), **WINDY)
FOUND: dict[str, tuple[SampleBlock, str, bool]] = {
    **{
        f"{reported} m/s reported of 20, wind {wind}": (
            flight(turning(120.0), reported_m_s=reported, wind=wind), "", False,
        )
        for wind in ((0.0, 0.0), (8.0, -6.0), (-14.0, 0.0), (0.0, 19.0))
        for reported in (18.0, 20.0, 22.0)
    },
    **{
        f"{factor} times the airspeed reported, wind {wind}": (
            flight(turning(120.0), reported_m_s=20.0 / factor, wind=wind),
            rf"{OF_HEADINGS}{factor:g} ± .* times the airspeed reported, with {m_s} m/s of wind",
            True,
        )
        for wind, m_s in (((0.0, 0.0), 0), ((8.0, -6.0), 10))
        for factor in (0.5, 0.77, 1.3, 2.0, 56.0)
    },
    "a noisy number": (
        flight(
            turning(120.0), wind=(5.0, 5.0),
            reported_m_s=np.random.default_rng(4).uniform(0.4, 1.5, round(120.0 * HZ)),
        ), "tail wind", False,
    ),
    "4000 m up": (HIGH, "", False),
    "as fast at 0 m": (replace(HIGH, altitude=0.0 * HIGH.altitude), OF_HEADINGS, True),
    "which may be as high": (replace(HIGH, altitude=np.nan * HIGH.altitude), "", False),
    "a tail wind that no flight has": (
        BLOCKED, "51 m/s over ground at an airspeed of 0.9 m/s", False,
    ),
    "on the ground": (replace(BLOCKED, on_ground=np.ones(len(BLOCKED))), "", False),
    "in hover": (replace(BLOCKED, held=np.full(len(BLOCKED), int(Held.HOVER))), "", False),
    # Faster than the aircraft, and still a wind; and a head wind may leave nothing.
    **{
        f"one heading, wind {wind}": (
            flight(STRAIGHT, true_m_s=10.0, reported_m_s=10.0, wind=wind), "", False,
        )
        for wind in ((12.0, 0.0), (-10.0, 0.0), (0.0, 12.0))
    },
    "bank and turn rate": (banked(20.0, 1.0), "", False),
    "bank and turn rate, slipping": (banked(20.0, 1.4), "", False),
    # It may slip so that its bank asks for 1.2 times the turn.
    "half the airspeed, by bank": (banked(10.0, 1.0), OF_BANK + "1.7 ± 0.2", False),
    "0.4 of the airspeed, by bank": (banked(8.0, 1.0), OF_BANK + "2.1 ± 0.2", False),
    "2.5 times the airspeed, by bank": (banked(50.0, 1.0), OF_BANK + "0.33 ± 0.04", False),
    # A factor of 1.5 at a sigma of 0.12, of 0.15 where it may be flown at 5000 m: 3.4, 2.7
    "a turn to the side of its bank": (banked(20.0 / 1.5, 1.2), OF_BANK, False),
    "a turn that may be high up": (banked(20.0 / 1.5, 1.2, altitude=np.nan), "", False),
    "a turn to the other side": (banked(20.0 / 1.5, 1.2, -1.0), "", False),
    "rectangles": (flight(legs(590.0, 20.0), **WINDY), OF_HEADINGS + "0.8 ±", True),
    "a large rectangle": (flight(legs(590.0, 125.0), **WINDY), OF_HEADINGS + "0.8 ±", True),
    "there and back": (flight(2.0 * legs(590.0, 60.0), **WINDY), "", False),
    # Of five with a least scatter of 5 % the mean is known to 2.2 %
    "two minutes of circles five times": (
        flight(turning(599.0), reported_m_s=10.0), OF_HEADINGS + "2 ± 0.045 times", True,
    ),
    "circles with a factor each": (
        SampleBlock.joined([
            flight(turning(120.0), reported_m_s=20.0 / factor, first_k=round(120 * HZ * i))
            for i, factor in enumerate((1.6, 2.6, 1.3, 2.0))
        ]), OF_HEADINGS + "1.8 ±", False,
    ),
    "another boot, which is another stretch": (
        SampleBlock.joined([BOOT, BOOT]), OF_HEADINGS + "0.8 ±", True,
    ),
}  # fmt: skip
"""Flights, a pattern of what is found, and whether that is a factor."""


@pytest.mark.parametrize("name", FOUND)
def test_an_airspeed_that_cannot_be_true_is_found_and_no_other(name: str) -> None:
    samples, said, is_factor = FOUND[name]
    found = finding(samples)

    assert (found is None) == (said == "")
    if found is not None:
        assert re.search(said, found.reason.text)
        assert (found.reason.id, found.is_factor) == ("airspeed_implausible", is_factor)


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


def test_the_seconds_that_it_keeps_are_bounded() -> None:
    check = AirspeedCheck(1.0 / HZ)
    samples = flight(np.zeros(HZ * 3000))
    for i in range(13):
        check.feed(replace(samples, k=samples.k + i * HZ * 3000))
    assert len(check._kept) == 36_000


NONE = (0.0, -3.0, math.nan, 1e300)


def record(flight: Flight, airspeed_m_s: float) -> bytes:
    lines = ["t,rudder [half-travel],r [rad/s],roll [rad],airspeed"]
    for k, t in enumerate(flight.t):
        rudder = (flight.pwm[k] - 1500) / 400
        lines.append(f"{t:.2f},{rudder},{flight.rates[k, 2]},{flight.roll[k]},{airspeed_m_s}")
    return "\n".join(lines).encode()


SENT = (3, 5), dataflash_flight.PARAMETERS, 4
FORMATS: dict[str, Callable[[Flight, float], bytes]] = {
    "a.tlog": lambda f, sent: dataflash_flight.telemetry_of(f, *SENT, 17.0, sent).data,
    "a.bin": lambda f, sent: dataflash_flight.logged(f, airspeed_m_s=sent).data,
    "a.ulg": lambda f, sent: ulog_flight.logged(f, sent).data,
    "a.csv": record,
}


@pytest.fixture(scope="module")
def onboard() -> Flight:
    return flown(25.0)


@pytest.mark.parametrize(
    ("name", "airspeed_m_s"),
    [
        *(("a.tlog", each) for each in NONE[1:]),
        *((name, 0.0) for name in FORMATS),
        ("a.csv", 1e300),
    ],
)
def test_a_flight_without_an_airspeed_is_answered_without_kappa(
    tmp_path: Path, onboard: Flight, name: str, airspeed_m_s: float
) -> None:
    with np.errstate(over="ignore"):
        sent = airspeed_m_s if name == "a.csv" else float(np.float32(airspeed_m_s))  # its field
    (tmp_path / name).write_bytes(FORMATS[name](onboard, sent))

    run = yawid.replay(tmp_path / name, rate=20.0)

    assert np.isnan(run.samples["airspeed"]).all()
    summary = run.summary
    assert summary.flight.dutch_roll.wn_rad_s == pytest.approx(4.0, rel=0.03)
    assert (summary.flight.kappa_rad_m, summary.flight.K_per_V) == (None, None)
    assert (summary.flight.airspeed_m_s, summary.flight.airspeed_source) == (None, None)


def test_the_bounds_are_next_to_nothing_and_three_times_sound() -> None:
    """What lies between is believed here: whether it may be true is another question."""
    speeds = np.array([0.09, 0.1, 1000.0, 1001.0, math.inf])

    np.testing.assert_array_equal(known(speeds), [math.nan, 0.1, 1000.0, math.nan, math.nan])


def test_a_blocked_pitot_leaves_the_flight_without_kappa_in_log_mcap_and_export(
    tmp_path: Path, onboard: Flight
) -> None:
    log = tmp_path / "a.tlog"
    log.write_bytes(dataflash_flight.telemetry_of(onboard, *SENT, 51.0, 0.9).data)

    mcap = replayed(log, tmp_path, "--rate", 20)
    assert main(["export", str(mcap), "-o", str(tmp_path / "a.csv")]) == 0

    flights: list[Answer] = []
    for path in (log, mcap, tmp_path / "a.csv"):
        rate = {"rate": 20.0} if path is log else {}
        summary = yawid.replay(path, **rate).summary
        found = summary.flight
        assert [each.airspeed_m_s for each in summary.manoeuvres] == [None]
        flights.append(found)
        assert found.dutch_roll.wn_rad_s == pytest.approx(4.0, rel=0.03)
        assert (found.kappa_rad_m, found.K_per_V, found.airspeed_m_s) == (None, None, None)
        said = [each for each in found.verdict.reasons if each.id == "airspeed_implausible"]
        assert [each.weight for each in said] == ["warning"]
    assert flights[0] == flights[1]
