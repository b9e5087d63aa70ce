"""Whole recorded flights, take-off to landing, with default options."""

import json
from collections.abc import Iterator
from functools import cache
from typing import Any

import numpy as np
import pytest
from flightlog import samples_of, summarised
from manoeuvre.streams import found_in
from places import SHARED_FLIGHTS

from yawid.blocks import SampleBlock
from yawid.config.run import RunConfig

pytestmark = pytest.mark.skipif(
    not SHARED_FLIGHTS.is_dir(), reason="the recorded flights are not here"
)
EXCITED = pytest.mark.parametrize("name", ["sitl_fbwa_50hz", "sitl_fbwa_stock_33hz"])
MOST_REST_S = 6.0
MOVES = 0.04
"""Of half the travel, within a second."""


@cache
def samples(name: str) -> SampleBlock:
    log = SHARED_FLIGHTS / f"{name}.tlog"
    return SampleBlock.joined(samples_of(log.read_bytes()).blocks)


@cache
def found(name: str) -> list[SampleBlock]:
    return found_in(samples(name))


def segments(name: str) -> list[dict[str, Any]]:
    told = json.loads((SHARED_FLIGHTS / f"{name}.segments.json").read_text(encoding="utf-8"))
    return [each for each in told["segments"] if each["name"] != "rest"]


def moves_in(block: SampleBlock, low_us: float, high_us: float) -> bool:
    inside = (block.boot_us >= low_us) & (block.boot_us < high_us)
    rudder = block.u[inside, 0]
    rudder = rudder[np.isfinite(rudder)]
    return len(rudder) > 0 and float(np.ptp(rudder)) > MOVES


def moving_seconds(name: str) -> Iterator[float]:
    """The beginnings, in us, of the seconds in which a segment that is no rest moves the rudder"""
    for segment in segments(name):
        for low in np.arange(1e3 * segment["t0_boot_ms"], 1e3 * segment["t1_boot_ms"] - 1e6, 1e6):
            if moves_in(samples(name), low, low + 1e6):
                yield float(low)


@EXCITED
def test_every_second_in_which_a_segment_moves_the_rudder_lies_in_a_manoeuvre(name: str):
    """And none has more than six seconds of rest at either end"""
    flight, seconds = samples(name), np.array(list(moving_seconds(name)))
    covered = np.concatenate([each.boot_us for each in found(name)])
    assert len(seconds) > 100
    for low in seconds:
        inside = (flight.boot_us >= low) & (flight.boot_us < low + 1e6)
        assert np.isin(flight.boot_us[inside], covered).all(), low / 1e6
    for each in found(name):
        first, last = float(each.boot_us[0]), float(each.boot_us[-1])
        assert moves_in(each, first, first + 1e6 * MOST_REST_S)
        assert moves_in(each, last - 1e6 * MOST_REST_S, last + 1)


@EXCITED
def test_the_flights_answer_is_right_and_its_sigma_covers_it(name: str):
    """CATALOG.md: 10.22 rad/s and 0.630 as flown, closed with the roll loop of FBWA

    A steep turn of five seconds at the end draws the stream away from it, and not the answer.
    """
    summary = summarised(SHARED_FLIGHTS / f"{name}.tlog", RunConfig())

    flight, roll = summary.flight, summary.flight.dutch_roll
    assert summary.deciding.usable
    assert (flight.loop, roll.level) == ("with_roll_loop", None)
    assert flight.airspeed_m_s == pytest.approx(22.0, abs=0.2)
    assert (roll.wn_rad_s, roll.zeta) == pytest.approx((10.22, 0.630), rel=0.04)
    assert abs(roll.wn_rad_s - 10.22) < 3.0 * roll.wn_std < 3.0 * 0.05 * 10.22
    assert abs(roll.zeta - 0.630) < 3.0 * roll.zeta_std
    assert {(each.verdict.usable, each.mode) for each in summary.manoeuvres} == {(True, "FBWA")}
